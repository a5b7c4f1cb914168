"""A key is a field of its table and an attribute of its settings: nothing else needs to know of it."""

import math
from dataclasses import dataclass
from typing import Annotated

import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from aerodft.adapters.config.keys import Duration, Text
from aerodft.adapters.config.reading import parse_toml, validated
from aerodft.adapters.config.station.observer_tables import CameraMotionTable
from aerodft.adapters.config.tables import NOT_IN_CONFIG_ID, SiAttribute, Uncertain, si_value
from aerodft.service import CameraMotionSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class ToySettings(CameraMotionSettings):
    """Settings with attributes that the product does not have."""

    pan_rate_radps: float = 0.0
    settle_ns: int = 0
    nickname: str | None = None
    sag_rad: float = 0.0


class ToyTable(CameraMotionTable):
    """A table with keys that the product does not have."""

    pan_rate_dps: float = 1.0
    settle_s: Annotated[Duration, NOT_IN_CONFIG_ID] = 0.5
    label: Annotated[Text | None, SiAttribute("nickname")] = None
    sag_deg: Uncertain[float] = Uncertain(value=0.0)


@given(st.floats(-90, 90), st.integers(0, 10**9).map(lambda ms: ms / 1000))
def test_a_new_key_is_read_in_si_and_written_with_its_unit(rate_dps, settle_s) -> None:
    text = f'limit_deg = 0.7\npan_rate_dps = {rate_dps!r}\nsettle_s = {settle_s}\nlabel = "a"\n'
    table = validated(ToyTable, parse_toml(text.encode()))
    settings = si_value(ToySettings, table)
    assert settings.pan_rate_radps == math.radians(rate_dps)
    assert settings.settle_ns == round(settle_s * 1e9)
    assert settings.nickname == "a"
    written = ToyTable.from_si(settings, stds=ToySettings()).to_toml()
    again = validated(ToyTable, parse_toml(tomli_w.dumps(written).encode()))
    assert si_value(ToySettings, again) == settings
    assert list(written)[-4:] == ["pan_rate_dps", "settle_s", "label", "sag_deg"]


def test_defaults_are_written_out_and_a_marked_key_is_not_in_the_id() -> None:
    written = ToyTable.from_si(si_value(ToySettings, ToyTable()), stds=ToySettings()).to_toml()
    assert written["pan_rate_dps"] == 1.0
    assert written["settle_s"] == 0.5
    assert written["sag_deg"] == {"value": 0.0, "std": 0.0}
    assert "label" not in written
    assert set(written) - set(ToyTable.without_marked(written)) == {"settle_s", "every_s", "ignore"}


def test_standard_deviations_are_a_value_of_their_own() -> None:
    table = ToyTable(sag_deg={"value": 2.0, "std": 0.1})
    assert si_value(ToySettings, table).sag_rad == math.radians(2.0)
    assert si_value(ToySettings, table, part="std").sag_rad == math.radians(0.1)
