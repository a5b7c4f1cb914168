"""Health and zoom tables: what is written reads back to the same bits, what makes no sense is refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from aerodft.adapters.config.tables import si_value
from aerodft.adapters.config.telemetry_tables import HealthTable, ZoomTable
from aerodft.service import HealthSettings, ZoomSettings

percents = st.decimals(0, 100, places=3).map(float)


@given(st.sets(percents, min_size=2, max_size=6), percents, percents)
def test_what_is_written_reads_back_to_the_same_bits(levels, at_percent, share) -> None:
    curve = [[level, 1.0 + k] for k, level in enumerate(sorted(levels))]
    zoom = si_value(ZoomSettings, ZoomTable(curve=curve, at_percent=at_percent, std_percent_per_doubling=share))
    assert si_value(ZoomSettings, ZoomTable(**ZoomTable.from_si(zoom).to_toml())) == zoom
    health = si_value(HealthSettings, HealthTable(max_loss_percent=share))
    assert si_value(HealthSettings, HealthTable(**HealthTable.from_si(health).to_toml())) == health


@pytest.mark.parametrize("curve", [[[0.0, 1.0]], [[50.0, 1.0], [50.0, 2.0]], [[0.0, 1.0], [101.0, 2.0]], [[0.0, 0.0]]])
def test_a_curve_that_is_none_is_refused(curve) -> None:
    with pytest.raises(ValidationError):
        ZoomTable(curve=curve)
