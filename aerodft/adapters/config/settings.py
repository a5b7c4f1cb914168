"""A station's place and input from its validated tables: SI units, radians, nanoseconds."""

import math
from pathlib import Path

from aerodft.adapters.config.inputs import Device, ImageInput, ImageSettings, Rate, Stills, Stream, Topics, VideoFile
from aerodft.adapters.config.station_tables import ImagesTable, OriginTable, TopicsTable
from aerodft.model.pose import GeoOrigin


def origin_from(table: OriginTable | None) -> GeoOrigin | None:
    """The station's ENU origin."""
    if table is None:
        return None
    return GeoOrigin(
        lat_rad=math.radians(table.lat_deg), lon_rad=math.radians(table.lon_deg), alt_msl_m=table.alt_msl_m
    )


def images_from(table: ImagesTable, folder: Path) -> ImageSettings:
    """Where images come from; relative paths start from ``folder``."""
    return ImageSettings(
        source=_image_input(table, folder),
        time_offset_s=table.time_offset_s or 0.0,
        time_drift=table.time_drift,
        time_reference_ns=table.time_reference,
        is_auto=table.time_offset_s is None,
    )


def _image_input(table: ImagesTable, folder: Path) -> ImageInput | None:
    if table.video is not None:
        return VideoFile(path=folder / table.video, start_ns=table.start)
    if table.stills is not None:
        return Stills(folder=folder / table.stills, pattern=table.pattern, utc_offset=table.utc_offset)
    if table.stream is not None:
        return Stream(url=table.stream)
    if table.device is not None:
        return Device(path=table.device)
    return None if table.rate_hz is None else Rate(rate_hz=table.rate_hz)


def topics_from(table: TopicsTable) -> Topics:
    """What the topics of other tools' recordings are."""
    return Topics(
        mavlink=(table.mavlink,) if isinstance(table.mavlink, str) else table.mavlink,
        images=() if table.images is None else (table.images,),
        camera=() if table.camera is None else (table.camera,),
    )
