import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerodft.sim.world import Island, River

MILLIMETRE = 1e-3

rivers = st.builds(
    River,
    origin_en_m=st.tuples(st.floats(-100, 100), st.floats(-100, 100)),
    azimuth_rad=st.floats(0, 2 * np.pi),
    width_m=st.floats(10, 40),
    width_swing_m=st.floats(0, 5),
    meander_m=st.floats(0, 5),
)


@given(river=rivers, station=st.floats(-300, 300))
def test_a_crossing_ends_on_both_banks(river: River, station: float) -> None:
    along, across = river.along_across(river.crossing(station))
    left, right = river.banks_m(along)
    np.testing.assert_allclose(across, [left[0], right[1]], atol=MILLIMETRE)


@given(river=rivers, station=st.floats(-300, 300))
def test_a_crossing_is_perpendicular_to_the_centreline(river: River, station: float) -> None:
    step = 1e-3
    ends = river.enu([station - step, station + step], river.centre_m([station - step, station + step]))
    tangent = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    left, right = river.crossing(station)
    middle = river.enu(station, river.centre_m(station))
    assert abs(np.dot(left - middle, tangent)) < MILLIMETRE
    assert abs(np.dot(right - middle, tangent)) < MILLIMETRE


def test_a_straight_river_is_as_wide_as_it_says() -> None:
    river = River(width_m=20.0, width_swing_m=0.0, meander_m=0.0)
    np.testing.assert_allclose(river.width_at(np.linspace(-50, 50, 11)), 20.0, atol=1e-9)


def test_the_left_bank_is_on_the_left_of_the_flow() -> None:
    river = River(origin_en_m=(5.0, 7.0), azimuth_rad=0.0, width_m=20.0, width_swing_m=0.0, meander_m=0.0)
    np.testing.assert_allclose(river.crossing(30.0), [[-5.0, 37.0, 0.0], [15.0, 37.0, 0.0]], atol=1e-9)


def test_an_island_has_shores_only_where_it_is() -> None:
    island = Island(station_m=0.0, length_m=40.0, width_m=6.0)
    river = River(meander_m=0.0, islands=(island,))
    shores = river.island_crossing([0.0, 100.0])
    assert np.linalg.norm(shores[0, 0] - shores[0, 1]) == pytest.approx(6.0)
    assert np.isnan(shores[1]).any()


def test_a_width_must_stay_positive() -> None:
    with pytest.raises(ValueError, match="must stay above 0"):
        River(width_m=3.0, width_swing_m=4.0)
