"""East and north against PROJ's geodesic."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pyproj import Geod

from aerodft.geometry import east_north, lat_lon
from aerodft.model import GeoOrigin

ORIGIN = GeoOrigin(lat_rad=math.radians(-35.3632), lon_rad=math.radians(149.1652), alt_msl_m=584.0)
WGS84 = Geod(ellps="WGS84")


@pytest.mark.parametrize("azimuth_deg", [0.0, 45.0, 133.0, 270.0])
def test_distance_and_azimuth_are_the_geodesics(azimuth_deg):
    sea_level = GeoOrigin(lat_rad=ORIGIN.lat_rad, lon_rad=ORIGIN.lon_rad, alt_msl_m=0.0)
    lon, lat, _ = WGS84.fwd(149.1652, -35.3632, azimuth_deg, 1000.0)
    east, north = east_north(sea_level, math.radians(lat), math.radians(lon))
    assert_allclose([math.hypot(east, north)], [1000.0], atol=0.001)
    off_deg = (math.degrees(math.atan2(east, north)) - azimuth_deg + 180) % 360 - 180
    assert abs(off_deg) < 0.01


def test_round_trip_of_many_points():
    points = np.random.default_rng(3).uniform(-2000, 2000, (100, 2))
    back = lat_lon(ORIGIN, points)
    assert_allclose(east_north(ORIGIN, back[:, 0], back[:, 1]), points, atol=0.001)


def test_origin_is_at_zero():
    assert_allclose(east_north(ORIGIN, ORIGIN.lat_rad, ORIGIN.lon_rad), [0.0, 0.0], atol=1e-9)
