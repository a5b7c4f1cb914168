"""The tables that say what a vehicle may say of itself, and how its reports of the camera's view are read."""

import math
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from aerodft.adapters.config.tables import FieldOfViewDeg, Gap, Many, NonNegative, Positive, Table, impossible
from aerodft.adapters.config.units import to_deg, to_ns, to_percent, to_s
from aerodft.model.zoom import ZoomSource
from aerodft.service.health_settings import HealthSettings
from aerodft.service.zoom_settings import ZoomSettings

_PERCENT = 100.0
ZoomName = Literal["CAMERA_SETTINGS", "CAMERA_FOV_STATUS", "VIDEO_STREAM_INFORMATION"]
Percent = Annotated[float, Field(ge=0, le=100)]
ZoomPoint = Annotated[tuple[Percent, Positive], Field(strict=False)]


class HealthTable(Table):
    """What a vehicle may say of itself before its telemetry is not believed."""

    heartbeat_s: Gap = 5.0
    max_test_ratio: Positive = 1.0
    gps_s: Gap = 4.0
    gps_horizontal_std_m: Positive = 3.0
    gps_vertical_std_m: Positive = 5.0
    max_loss_percent: Percent = 10.0


class ZoomTable(Table):
    """How reports of the camera's view are read; the camera file is the reference."""

    order: Many[ZoomName] = ("CAMERA_SETTINGS", "CAMERA_FOV_STATUS", "VIDEO_STREAM_INFORMATION")
    at_percent: Percent = 0.0
    curve: Many[ZoomPoint] = ()
    reported_hfov_deg: FieldOfViewDeg | None = None
    hfov_std_deg: NonNegative = 0.5
    std_percent_per_doubling: NonNegative = 2.0
    camera: Annotated[int, Field(ge=1, le=255)] | None = None
    stream: Annotated[int, Field(ge=0, le=255)] | None = None
    max_gap_s: Gap = 2.0

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        if len(self.curve) == 1 or any(after[0] <= before[0] for before, after in pairwise(self.curve)):
            expected = "two or more [percent, times], percent ascending, like [[0, 1.0], [100, 6.0]]"
            raise impossible("curve", got=f"{[list(point) for point in self.curve]}", expected=expected)
        return self


def health_from(table: HealthTable) -> HealthSettings:
    """The table in SI units."""
    return HealthSettings(
        heartbeat_ns=to_ns(table.heartbeat_s),
        max_ratio=table.max_test_ratio,
        gps_ns=to_ns(table.gps_s),
        horizontal_std_m=table.gps_horizontal_std_m,
        vertical_std_m=table.gps_vertical_std_m,
        loss_share=table.max_loss_percent / _PERCENT,
    )


def health_document(settings: HealthSettings) -> dict[str, Any]:
    """The settings as a table."""
    return {
        "heartbeat_s": to_s(settings.heartbeat_ns),
        "max_test_ratio": settings.max_ratio,
        "gps_s": to_s(settings.gps_ns),
        "gps_horizontal_std_m": settings.horizontal_std_m,
        "gps_vertical_std_m": settings.vertical_std_m,
        "max_loss_percent": to_percent(settings.loss_share),
    }


def zoom_from(table: ZoomTable) -> ZoomSettings:
    """The table in SI units."""
    reported = table.reported_hfov_deg
    return ZoomSettings(
        order=tuple(ZoomSource(name) for name in table.order),
        level=table.at_percent / _PERCENT,
        curve=tuple((percent / _PERCENT, times) for percent, times in table.curve),
        reported_hfov_rad=None if reported is None else math.radians(reported),
        hfov_std_rad=math.radians(table.hfov_std_deg),
        std_per_doubling=table.std_percent_per_doubling / _PERCENT,
        camera=table.camera,
        stream=table.stream,
        max_gap_ns=to_ns(table.max_gap_s),
    )


def zoom_document(settings: ZoomSettings) -> dict[str, Any]:
    """The settings as a table; what is not stated is left out."""
    reported = settings.reported_hfov_rad
    table = {
        "order": [str(source) for source in settings.order],
        "at_percent": to_percent(settings.level),
        "curve": [[to_percent(level), times] for level, times in settings.curve] or None,
        "reported_hfov_deg": None if reported is None else to_deg(reported),
        "hfov_std_deg": to_deg(settings.hfov_std_rad),
        "std_percent_per_doubling": to_percent(settings.std_per_doubling),
        "camera": settings.camera,
        "stream": settings.stream,
        "max_gap_s": to_s(settings.max_gap_ns),
    }
    return {key: value for key, value in table.items() if value is not None}
