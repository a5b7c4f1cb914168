"""The table ``[watch]`` of a fixed camera's station: what it is held against, and what counts as moved."""

import math
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from aerodft.adapters.config.station import Watch
from aerodft.adapters.config.tables import Many, NonNegative, Pixel, Table, Text
from aerodft.adapters.config.units import to_deg
from aerodft.errors import ConfigError
from aerodft.model.measurement import ProjectionModel
from aerodft.model.probe import Probe
from aerodft.model.steadiness import STEADY
from aerodft.service.watching import WatchSettings

Polygon = Annotated[tuple[Pixel, ...], Field(strict=False, min_length=3)]


class WatchTable(Table):
    """How a fixed camera is watched for bumps."""

    limit_deg: Annotated[float, Field(ge=0.01, le=45)] = 0.2
    every_s: Annotated[float, Field(ge=0, le=3600)] = 1.0
    confirm: Annotated[int, Field(ge=1, le=100)] = 3
    lever_arm_m: NonNegative = 0.2
    ignore: Many[Polygon] = ()
    reference: Text | None = None


def watch_from(
    table: WatchTable | None, model: ProjectionModel, probes: tuple[Probe, ...], where: str, folder: Path
) -> Watch | None:
    """How the camera is watched; None without the table.

    Raises:
        ConfigError: The equations of the paper are to be used, or a probe takes the name of the steady points.
    """
    if table is None:
        return None
    if model is ProjectionModel.DFT:
        got, hint = 'it beside camera.model = "dft"', "the equations of the paper know no roll"
        raise ConfigError("watch", where=where, got=got, expected='"pinhole", or no [watch]', hint=hint)
    if any(probe.name == STEADY for probe in probes):
        got, expected = f'"{STEADY}", beside [watch]', "another name: the points that stand still have this one"
        raise ConfigError("probe.name", where=where, got=got, expected=expected)
    settings = WatchSettings(
        limit_rad=math.radians(table.limit_deg),
        every_s=table.every_s,
        confirm=table.confirm,
        lever_arm_m=table.lever_arm_m,
        ignore=table.ignore,
    )
    return Watch(settings=settings, reference=None if table.reference is None else folder / table.reference)


def watch_document(watch: Watch) -> dict[str, Any]:
    """The table as TOML keys; reading them gives the same settings."""
    settings = watch.settings
    document: dict[str, Any] = {
        "limit_deg": to_deg(settings.limit_rad),
        "every_s": settings.every_s,
        "confirm": settings.confirm,
        "lever_arm_m": settings.lever_arm_m,
        "ignore": [[list(pixel) for pixel in polygon] for polygon in settings.ignore],
    }
    if watch.reference is not None:
        document["reference"] = str(watch.reference.absolute())
    return document


NOT_OF_THE_NUMBERS = ("every_s", "ignore", "reference")
"""What decides only which points are looked for: numbers depend on the points that were found."""
