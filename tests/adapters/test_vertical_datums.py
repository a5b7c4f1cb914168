"""Altitudes above other vertical datums, with geoid grids that the tests write, and without any."""

import json
import os
import struct
import subprocess
import sys

import numpy as np
import pytest

UNDULATIONS_M = {"egm96_15.gtx": 47.25, "egm08_25.gtx": 47.75}  # of everywhere
PROGRAM = """
import json, sys
from aerodft.adapters.vertical_datums import Altitude
from aerodft.errors import ConfigError
from aerodft.model import GeoOrigin
found = []
for datum, own in json.loads(sys.argv[1]):
    try:
        found.append(Altitude(GeoOrigin(lat_rad=0.8, lon_rad=0.1, alt_msl_m=100.0)).above(datum, own))
    except ConfigError as error:
        found.append(str(error))
print(json.dumps(found))
"""
PAIRS = (
    ("EGM96", "EGM96"),
    ("EPSG:5773", "egm96"),
    ("ellipsoid", "EGM96"),
    ("EGM2008", "ellipsoid"),
    ("EGM96", "EGM2008"),
    ("msl", "EGM96"),
    ("msl", "ellipsoid"),
)


def above(folder, pairs=PAIRS):
    """What the pairs give where PROJ has the grids of a folder alone."""
    environment = {**os.environ, "PROJ_USER_WRITABLE_DIRECTORY": str(folder), "PROJ_NETWORK": "OFF"}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, json.dumps(pairs)], env=environment, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def with_grids(tmp_path_factory):
    folder = tmp_path_factory.mktemp("grids")
    for name, undulation_m in UNDULATIONS_M.items():
        head = struct.pack(">ddddii", -90.0, -180.0, 1.0, 1.0, 181, 361)
        (folder / name).write_bytes(head + np.full((181, 361), undulation_m, dtype=">f4").tobytes())
    return above(folder)


def test_grids_bring_altitudes_from_one_datum_to_another(with_grids):
    altitudes_m = [each[0] for each in with_grids]
    assert altitudes_m == pytest.approx([100.0, 100.0, 147.25, 52.25, 100.5, 100.0, 52.25], abs=1e-6)


def test_a_datum_that_nobody_names_is_known_to_a_metre_and_no_better(with_grids):
    stds_m = [each[1] for each in with_grids]
    assert stds_m[:2] == [0.0, 0.0]
    assert all(std_m >= 1.0 for std_m in stds_m[2:])
    assert stds_m[6] > stds_m[3]  # the sea is no geoid


def test_without_a_grid_two_sea_levels_differ_by_a_std_and_the_ellipsoid_is_refused(tmp_path):
    found = above(tmp_path)
    assert found[:2] == [[100.0, 0.0]] * 2
    for said, grid in ((found[2], "us_nga_egm96_15.tif"), (found[3], "us_nga_egm08_25.tif")):
        assert "ground.level_datum: no geoid grid: got none installed" in said
        assert f"grid {grid} by `pyproj sync`" in said
    assert found[4:6] == [[100.0, 1.0]] * 2
    assert "no geoid grid" in found[6]


def test_what_is_no_vertical_datum_is_refused(tmp_path):
    found = above(tmp_path, [("NHN", "msl"), ("EPSG:4326", "msl"), ("msl", "sea"), ("EPSG:999999", "msl")])
    for said, key in zip(found, ("level_datum", "level_datum", "altitude_datum", "level_datum"), strict=True):
        assert said.startswith(f"ground.{key}: got ")
        assert "level_zero_m" in said
