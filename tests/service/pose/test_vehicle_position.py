"""Where the vehicle is: over the 180th meridian, and when a position cannot be true."""

import math

import numpy as np
import pytest

from aerodft.conventions import SECOND_NS
from aerodft.model import PositionTrack
from aerodft.service import LAST, HeightSettings
from aerodft.service.pose.vehicle_position import VehiclePositions
from aerodft.service.streams import Missing, Query

METRE_RAD = 1 / 6_378_137.0  # of longitude on the equator
HALF_SECOND = SECOND_NS // 2


def places(lat_rad, lon_rad, alt_msl_m=(50.0, 50.0)):
    """Two positions, a second apart, 50 m above home."""
    made = VehiclePositions(HeightSettings(), None)
    stamps_ns = np.array([0, SECOND_NS])
    track = PositionTrack(
        arrival_ns=stamps_ns,
        boot_ns=stamps_ns,
        lat_rad=np.array(lat_rad),
        lon_rad=np.array(lon_rad),
        alt_msl_m=np.array(alt_msl_m),
        height_home_m=np.full(2, 50.0),
    )
    made.append(track, stamps_ns)
    return made


def at(made, stamp_ns):
    """As of the last tick, when nothing more will come."""
    return made.at(Query.final(np.array([stamp_ns]), LAST))


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_flight_over_the_180th_meridian(direction):
    """20 m/s along the equator; in the middle of the second it is right on the meridian, a little later beyond."""
    half = direction * 10 * METRE_RAD
    made = places([0.0, 0.0], [direction * math.pi - half, half - direction * math.pi])
    place = at(made, HALF_SECOND + SECOND_NS // 10)
    assert place.lat_lon_alt[0, 1] == pytest.approx(half / 5 - direction * math.pi, abs=1e-12)
    np.testing.assert_allclose(place.east_north_m, [[direction * 12.0, 0.0]], atol=1e-3)
    np.testing.assert_allclose(place.velocity_enu_mps, [[direction * 20.0, 0.0, 0.0]], atol=1e-3)


@pytest.mark.parametrize(("apart_m", "is_known"), [(40.0, True), (190.0, True), (210.0, False), (1e6, False)])
def test_between_two_positions_that_nothing_flies_between_there_is_none(apart_m, is_known):
    found = at(places([0.0, 0.0], [0.0, apart_m * METRE_RAD]), HALF_SECOND)
    assert found.missing.tolist() == [Missing.NOTHING if is_known else Missing.STALE]
    assert np.isfinite(found.east_north_m).all() == is_known


def test_a_log_without_altitudes_has_places_all_the_same():
    """Its origin's altitude is unknown, and what climbs is the height above home."""
    made = places([0.0, 0.0], [0.0, 10 * METRE_RAD], alt_msl_m=(math.nan, math.nan))
    assert made.origin.alt_msl_m is None
    found = at(made, HALF_SECOND)
    np.testing.assert_allclose(found.east_north_m, [[5.0, 0.0]], atol=1e-3)
    np.testing.assert_allclose(found.velocity_enu_mps, [[10.0, 0.0, 0.0]], atol=1e-3)
    assert np.isnan(found.lat_lon_alt).tolist() == [[False, False, True]]
