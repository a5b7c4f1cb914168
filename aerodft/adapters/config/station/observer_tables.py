"""The tables ``[camera_motion]``, ``[objects]`` and ``[river]``: what is looked for in a station's images."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from aerodft.adapters.config.tables import (
    NOT_IN_CONFIG_ID,
    Duration,
    Many,
    NonNegative,
    Pixel,
    Positive,
    SiAttribute,
    Table,
    Text,
    si_value,
)
from aerodft.errors import ConfigError
from aerodft.model import STEADY, PixelSource, Probe, ProbeKind, ProjectionModel
from aerodft.service import OBJECTS, CameraMotionSettings, ObjectSettings, RiverLook

Polygon = Annotated[tuple[Pixel, ...], Field(strict=False, min_length=3)]


class CameraMotionTable(Table):
    """How a fixed camera is watched for bumps: what it is held against, and what counts as moved."""

    limit_deg: Annotated[float, Field(ge=0.01, le=45)] = 0.2
    every_s: Annotated[float, Field(ge=0, le=3600), NOT_IN_CONFIG_ID] = 1.0
    confirm_looks: Annotated[int, Field(ge=1, le=100)] = 3
    lever_arm_m: NonNegative = 0.2
    ignore: Annotated[Many[Polygon], NOT_IN_CONFIG_ID] = ()
    reference: Annotated[Text | None, NOT_IN_CONFIG_ID] = None


class ObjectsTable(Table):
    """How moving objects are looked for and followed over the ground; the defaults are those of ``ObjectSettings``."""

    detect: bool = True
    every_s: Annotated[Duration, NOT_IN_CONFIG_ID] = 0.0
    shadows: Annotated[bool, NOT_IN_CONFIG_ID] = True
    min_area_px: Annotated[int, Field(ge=1, le=10_000_000), NOT_IN_CONFIG_ID] = 60
    ignore: Annotated[Many[Polygon], NOT_IN_CONFIG_ID] = ()
    std_px: Positive = 2.0
    speed_mps: Positive = 3.0
    acceleration_mps2: Positive = 0.5
    confirm_looks: Annotated[int, Field(ge=1, le=1000)] = 3
    track_timeout_s: Duration = 5.0
    distances_within_m: NonNegative = 0.0


class RiverTable(Table):
    """How banks are looked for, for probes of kind ``river``; the defaults are those of ``RiverLook``."""

    every_s: Duration = 1.0
    spacing_m: Positive = 1.0
    seed: Annotated[Pixel | None, SiAttribute("seed_px")] = None
    max_range_m: Positive | None = None


def camera_motion_from(
    table: CameraMotionTable | None, model: ProjectionModel, probes: tuple[Probe, ...], where: str, folder: Path
) -> CameraMotionSettings | None:
    """How the camera is watched; None without the table.

    Raises:
        ConfigError: The equations of the paper are to be used, or a probe takes the name of the steady points.
    """
    if table is None:
        return None
    refuse_beside_paper("camera_motion", model, where)
    if any(probe.name == STEADY for probe in probes):
        got, expected = f'"{STEADY}", beside [camera_motion]', "another name: the points that stand still have this one"
        raise ConfigError("probe.name", where=where, got=got, expected=expected)
    return si_value(CameraMotionSettings, table, relative_to=folder)


def objects_from(
    table: ObjectsTable | None, model: ProjectionModel, probes: tuple[Probe, ...], where: str
) -> ObjectSettings | None:
    """How objects are followed; None without the table.

    Raises:
        ConfigError: The equations of the paper are to be used, or a probe takes an object's name.
    """
    if table is None:
        return None
    refuse_beside_paper("objects", model, where)
    taken = next((probe.name for probe in probes if probe.name == OBJECTS or probe.name.startswith("object-")), None)
    if taken is not None:
        got, expected = f'"{taken}", beside [objects]', "another name: objects that move have such names"
        raise ConfigError("probe.name", where=where, got=got, expected=expected)
    return si_value(ObjectSettings, table)


def river_from(
    table: RiverTable | None, model: ProjectionModel, probes: tuple[Probe, ...], where: str
) -> RiverLook | None:
    """How banks are looked for; None without the table.

    Raises:
        ConfigError: The equations of the paper are to be used, or no probe is measured from banks.
    """
    if table is None:
        return None
    refuse_beside_paper("river", model, where)
    if not river_probes(probes):
        expected = 'a [[probe]] with kind = "river" and observed = true'
        raise ConfigError("river", where=where, got="no probe that is measured from banks", expected=expected)
    return si_value(RiverLook, table)


def river_probes(probes: tuple[Probe, ...]) -> tuple[Probe, ...]:
    """The probes whose banks may be looked for."""
    return tuple(each for each in probes if each.kind == ProbeKind.RIVER and each.source is PixelSource.OBSERVED)


def refuse_beside_paper(
    key: str, model: ProjectionModel, where: str, *, shown: str = "", know: str = "no roll"
) -> None:
    """Refuse a table that the equations of the paper have no place for.

    Args:
        key: The table's.
        model: Of the station.
        where: The station file's name in messages.
        shown: The table as files have it; empty for ``[key]``.
        know: What they know.

    Raises:
        ConfigError: The station measures with these equations.
    """
    if model is ProjectionModel.DFT:
        got, expected = 'it beside camera.model = "dft"', f'"pinhole", or no {shown or f"[{key}]"}'
        raise ConfigError(key, where=where, got=got, expected=expected, hint=f"the equations of the paper know {know}")
