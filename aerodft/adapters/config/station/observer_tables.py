"""The tables of what looks at a station's images: camera motion, moving objects, rivers."""

from typing import Annotated

from pydantic import Field

from aerodft.adapters.config import keys
from aerodft.adapters.config.tables import NOT_IN_CONFIG_ID, SiAttribute, Table

Polygon = Annotated[tuple[keys.Pixel, ...], Field(strict=False, min_length=3)]


class CameraMotionTable(Table):
    """Settings of the watch over a fixed camera: the reference, and the rotation that counts as moved."""

    limit_deg: Annotated[float, Field(ge=0.01, le=45)] = 0.2
    every_s: Annotated[float, Field(ge=0, le=3600), NOT_IN_CONFIG_ID] = 1.0
    confirm_looks: Annotated[int, Field(ge=1, le=100)] = 3
    lever_arm_m: keys.NonNegative = 0.2
    ignore: Annotated[keys.Many[Polygon], NOT_IN_CONFIG_ID] = ()
    reference: Annotated[keys.Text | None, NOT_IN_CONFIG_ID] = None


class ObjectsTable(Table):
    """Settings of detecting and following moving objects; the defaults are those of ``ObjectSettings``."""

    detect: bool = True
    every_s: Annotated[keys.Duration, NOT_IN_CONFIG_ID] = 0.0
    shadows: Annotated[bool, NOT_IN_CONFIG_ID] = True
    min_area_px: Annotated[int, Field(ge=1, le=10_000_000), NOT_IN_CONFIG_ID] = 60
    ignore: Annotated[keys.Many[Polygon], NOT_IN_CONFIG_ID] = ()
    std_px: keys.Positive = 2.0
    speed_mps: keys.Positive = 3.0
    acceleration_mps2: keys.Positive = 0.5
    confirm_looks: Annotated[int, Field(ge=1, le=1000)] = 3
    track_timeout_s: keys.Duration = 5.0
    distances_within_m: keys.NonNegative = 0.0


class HintsTable(Table):
    """Pixels that a person marked as water or land in the first image."""

    water: Annotated[keys.Many[keys.Pixel], SiAttribute("water_px")] = ()
    land: Annotated[keys.Many[keys.Pixel], SiAttribute("land_px")] = ()


class RiverTable(Table):
    """Settings of finding banks for probes of kind ``river``; the defaults are those of ``RiverSettings``."""

    every_s: keys.Duration = 1.0
    spacing_m: keys.Positive = 1.0
    seed: Annotated[keys.Pixel | None, SiAttribute("seed_px")] = None
    hints: HintsTable = HintsTable()
    max_range_m: keys.Positive | None = None
