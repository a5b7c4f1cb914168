"""The table ``[objects]`` of a station: what moves before its camera is followed over the ground."""

from typing import Annotated, Any, Final

from pydantic import Field

from aerodft.adapters.config.tables import Duration, Many, NonNegative, Positive, Table
from aerodft.adapters.config.watch_tables import Polygon
from aerodft.errors import ConfigError
from aerodft.model.measurement import ProjectionModel
from aerodft.model.probe import Probe
from aerodft.service.objects import OBJECTS, ObjectSettings


class ObjectsTable(Table):
    """How moving objects are looked for and followed; the defaults are those of ``ObjectSettings``."""

    detect: bool = True
    every_s: Duration = 0.0
    shadows: bool = True
    least_px: Annotated[int, Field(ge=1, le=10_000_000)] = 60
    ignore: Many[Polygon] = ()
    std_px: Positive = 2.0
    speed_mps: Positive = 3.0
    acceleration_mps2: Positive = 0.5
    confirm: Annotated[int, Field(ge=1, le=1000)] = 3
    forget_s: Duration = 5.0
    distances_within_m: NonNegative = 0.0


def objects_from(
    table: ObjectsTable | None, model: ProjectionModel, probes: tuple[Probe, ...], where: str
) -> ObjectSettings | None:
    """How objects are followed; None without the table.

    Args:
        table: The table.
        model: Of the station.
        probes: Likewise.
        where: The station file's name in messages.

    Raises:
        ConfigError: The equations of the paper are to be used, or a probe takes an object's name.
    """
    if table is None:
        return None
    if model is ProjectionModel.DFT:
        got, hint = 'it beside camera.model = "dft"', "the equations of the paper know no roll"
        raise ConfigError("objects", where=where, got=got, expected='"pinhole", or no [objects]', hint=hint)
    taken = next((probe.name for probe in probes if probe.name == OBJECTS or probe.name.startswith("object-")), None)
    if taken is not None:
        got, expected = f'"{taken}", beside [objects]', "another name: objects that move have such names"
        raise ConfigError("probe.name", where=where, got=got, expected=expected)
    return ObjectSettings(**table.model_dump())


def objects_document(settings: ObjectSettings) -> dict[str, Any]:
    """The table as TOML keys; reading them gives the same settings."""
    document = {name: getattr(settings, name) for name in ObjectsTable.model_fields}
    return {**document, "ignore": [[list(pixel) for pixel in polygon] for polygon in settings.ignore]}


SEEN_ONLY: Final = ("every_s", "shadows", "least_px", "ignore")
"""What decides only what is seen: numbers depend on the outlines that were found."""
