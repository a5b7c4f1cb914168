"""Probes from a station's tables, checked against its camera and one another."""

from aerodft.adapters.config.station_tables import ProbeTable
from aerodft.errors import ConfigError
from aerodft.model.camera import Camera
from aerodft.model.probe import PixelSource, Probe, ProbeKind

_EDGE_PX = -0.5  # pixel (0, 0) is the centre of the top-left pixel


def probes_from(tables: tuple[ProbeTable, ...], camera: Camera, where: str) -> tuple[Probe, ...]:
    """The configured probes.

    Raises:
        ConfigError: A name twice, a fixed pixel outside the camera's image, or a probe on top of what is no height.
    """
    names = [table.name for table in tables]
    right_px, bottom_px = camera.width_px + _EDGE_PX, camera.height_px + _EDGE_PX
    for index, table in enumerate(tables):
        if table.name in names[:index]:
            raise ConfigError(
                f"probe[{index}].name", where=where, got=f'"{table.name}" again', expected="a name of its own"
            )
        for u, v in table.pixels or ():
            if not (_EDGE_PX <= u <= right_px and _EDGE_PX <= v <= bottom_px):
                raise ConfigError(
                    f'probe "{table.name}" lies outside the image',
                    where=where,
                    got=f"pixel ({u:g}, {v:g})",
                    expected=f"within (-0.5, -0.5) to ({right_px:g}, {bottom_px:g}) of {camera.name}",
                )
        if table.on_top_of is not None:
            _check_object(table.on_top_of, tables, f"{where}: probe[{index}].on_top_of")
    return tuple(
        Probe(
            name=table.name,
            kind=table.kind,
            source=_source(table),
            pixels=table.pixels or (),
            std_px=table.std_px,
            elevation_m=table.elevation_m,
            elevation_std_m=table.elevation_std_m,
            on_top_of=table.on_top_of,
            at_ns=table.at,
        )
        for table in tables
    )


def _source(table: ProbeTable) -> PixelSource:
    if table.tracked:
        return PixelSource.TRACKED
    return PixelSource.OBSERVED if table.observed else PixelSource.FIXED


def _check_object(name: str, tables: tuple[ProbeTable, ...], where: str) -> None:
    """Refuse to lie on top of anything but an object that stands on the ground, seen in fixed pixels."""
    found = next((table for table in tables if table.name == name), None)
    if found is None:
        got = f'"{name}", which is not there'
    elif found.kind is not ProbeKind.HEIGHT:
        got = f'"{name}", which measures a {found.kind}'
    elif found.observed or found.tracked:
        got = f'"{name}", of which the pixels are {_source(found)}'
    elif found.on_top_of is not None:
        got = f'"{name}", which lies on top of "{found.on_top_of}"'
    else:
        return
    raise ConfigError("no object", where=where, got=got, expected="a height on the ground with pixels of its own")
