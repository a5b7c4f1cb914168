"""The table ``[river]`` of a station: banks are looked for in its images, for its probes of kind ``river``."""

from typing import Any

from aerodft.adapters.config.tables import Duration, Pixel, Positive, Table
from aerodft.errors import ConfigError
from aerodft.model.measurement import ProjectionModel
from aerodft.model.probe import PixelSource, Probe, ProbeKind
from aerodft.vision.river_look import RiverLook


class RiverTable(Table):
    """How banks are looked for; the defaults are those of ``RiverLook``."""

    every_s: Duration = 1.0
    spacing_m: Positive = 1.0
    seed: Pixel | None = None
    max_range_m: Positive | None = None


def river_from(
    table: RiverTable | None, model: ProjectionModel, probes: tuple[Probe, ...], where: str
) -> RiverLook | None:
    """How banks are looked for; None without the table.

    Raises:
        ConfigError: The equations of the paper are to be used, or no probe is measured from banks.
    """
    if table is None:
        return None
    if model is ProjectionModel.DFT:
        got, hint = 'it beside camera.model = "dft"', "the equations of the paper know no roll"
        raise ConfigError("river", where=where, got=got, expected='"pinhole", or no [river]', hint=hint)
    if not river_probes(probes):
        expected = 'a [[probe]] with kind = "river" and observed = true'
        raise ConfigError("river", where=where, got="no probe that is measured from banks", expected=expected)
    return RiverLook(
        every_s=table.every_s, spacing_m=table.spacing_m, seed_px=table.seed, max_range_m=table.max_range_m
    )


def river_probes(probes: tuple[Probe, ...]) -> tuple[Probe, ...]:
    """The probes whose banks may be looked for."""
    return tuple(each for each in probes if each.kind is ProbeKind.RIVER and each.source is PixelSource.OBSERVED)


def river_document(look: RiverLook) -> dict[str, Any]:
    """The table as TOML keys; reading them gives the same settings."""
    document: dict[str, Any] = {"every_s": look.every_s, "spacing_m": look.spacing_m}
    if look.seed_px is not None:
        document["seed"] = list(look.seed_px)
    if look.max_range_m is not None:
        document["max_range_m"] = look.max_range_m
    return document
