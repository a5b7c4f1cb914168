"""Landmarks in a station's file: where they are, what is refused, and that nothing is lost in a recording."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pyproj import Geod

from aerodft.adapters.config.station import parse_station, resolved_toml
from aerodft.errors import ConfigError
from aerodft.service import DRIFT

CAMERA = '[camera]\nname = "A"\nwidth_px = 100\nheight_px = 50\nhfov_deg = 90\n'
ORIGIN = "origin = { lat_deg = 47.0, lon_deg = 15.0, alt_msl_m = 350.0 }\n"
FLIGHT = '[station]\nname = "s"\n' + ORIGIN + CAMERA + "[telemetry]\n"
ANYWHERE = FLIGHT.replace(ORIGIN, "")
LOCAL = '[[landmark]]\nname = "post"\nposition_m = [3.5, -20.25, 0.125]\nstd_m = 0.02\nstd_px = 0.7\n'
ON_MAP = '[[landmark]]\nname = "gate"\nlat_deg = 47.001\nlon_deg = 15.002\nalt_msl_m = 351.5\nstd_m = [1, 2, 3]\n'
TUNED = (
    "[live_calibration]\nnoise_share = 0.2\ngate_probability = 0.99\noutlier_fraction = 0\n"
    "noise = { tilt_deg = 0.07 }\ninitial = { height_m = 3.0, heading_deg = 11.0 }\ndrift = { horizontal_m = 0.3 }\n"
)


def parsed(text):
    return parse_station(text.encode(), where="x.toml", folder=Path())


def test_a_place_in_metres_is_from_the_origin():
    (post,) = parsed(FLIGHT + LOCAL).live.landmarks
    assert (post.name, post.position_enu_m, post.std_m, post.std_px) == (
        "post", (3.5, -20.25, 0.125), (0.02, 0.02, 0.02), 0.7,
    )  # fmt: skip


def test_a_place_on_the_map_is_as_far_from_the_origin_as_the_geodesic():
    (gate,) = parsed(FLIGHT + ON_MAP).live.landmarks
    azimuth_deg, _, distance_m = Geod(ellps="WGS84").inv(15.0, 47.0, 15.002, 47.001)
    at_height = distance_m * (1 + 350.0 / 6.37e6)
    expected = at_height * np.array([math.sin(math.radians(azimuth_deg)), math.cos(math.radians(azimuth_deg))])
    assert_allclose(gate.position_enu_m[:2], expected, atol=0.002)
    assert gate.position_enu_m[2] == 1.5
    assert gate.std_m == (1.0, 2.0, 3.0)


def test_what_is_left_out_has_its_default_and_what_is_said_counts():
    plain, tuned = parsed(FLIGHT + LOCAL).live, parsed(FLIGHT + LOCAL + TUNED).live
    assert plain.drift == DRIFT
    assert (plain.noise.tilt_rad, plain.initial.height_agl_m) == (None, None)
    assert tuned.drift == replace(DRIFT, horizontal_m=0.3)
    assert (tuned.noise.tilt_rad, tuned.noise.height_agl_m) == (math.radians(0.07), None)
    assert (tuned.initial.height_agl_m, tuned.initial.heading_rad) == (3.0, math.radians(11.0))
    assert (tuned.noise_share, tuned.gate_probability, tuned.outlier_fraction) == (0.2, 0.99, 0.0)


def test_landmarks_survive_the_resolved_text_to_the_bit():
    station = parsed(FLIGHT + ON_MAP + LOCAL + TUNED)
    again = parsed(resolved_toml(station))
    assert again.live == station.live
    assert again.pipeline.config_id == station.pipeline.config_id
    assert resolved_toml(again) == resolved_toml(station)


def test_landmarks_count_for_the_configurations_id_and_their_settings_only_with_them():
    plain, tuned, with_landmark = (parsed(FLIGHT + more) for more in ("", TUNED, LOCAL))
    assert plain.live is None
    assert tuned.live is None
    assert plain.pipeline.config_id == tuned.pipeline.config_id
    moved = parsed(FLIGHT + LOCAL.replace("3.5", "3.6"))
    ids = {each.pipeline.config_id for each in (plain, with_landmark, moved, parsed(FLIGHT + LOCAL + TUNED))}
    assert len(ids) == 4


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (FLIGHT + LOCAL + LOCAL, 'x.toml: landmark[1].name: got "post" again, expected a name of its own'),
        (FLIGHT + LOCAL + "lat_deg = 3\n", "landmark[0].lat_deg: it stands beside position_m, expected one of the two"),
        (
            FLIGHT + ON_MAP.replace("alt_msl_m", "# "),
            "landmark[0].alt_msl_m: got nothing, expected lat_deg, lon_deg and alt_msl_m, or position_m",
        ),
        (FLIGHT + LOCAL.replace("-20.25, ", ""), "x.toml: landmark[0].position_m"),
        (FLIGHT + LOCAL.replace("0.02", "-0.02"), "x.toml: landmark[0].std_m[0]: got -0.02, expected at least 0"),
        (FLIGHT + LOCAL.replace("0.7", "0"), "x.toml: landmark[0].std_px: got 0, expected more than 0"),
        (ANYWHERE + LOCAL, "x.toml: station.origin: got nothing beside [[landmark]], expected { lat_deg, lon_deg,"),
        (
            FLIGHT.replace(", alt_msl_m = 350.0", "") + ON_MAP,
            'station.origin.alt_msl_m: got nothing, expected metres, because landmark "gate" has alt_msl_m',
        ),
        (
            ANYWHERE.replace("[telemetry]", "[pose]\nheight_agl_m = 8\ntilt_deg = 60") + LOCAL,
            "x.toml: landmark: it stands beside [pose], expected [telemetry]; find a fixed camera's pose with aerodft",
        ),
        (
            FLIGHT.replace("[camera]", '[camera]\nmodel = "dft"') + LOCAL,
            'x.toml: landmark: it stands beside camera.model = "dft", expected "pinhole", or no [[landmark]]',
        ),
        (
            FLIGHT + "[live_calibration]\nnoise_share = 1\n",
            "x.toml: live_calibration.noise_share: got 1, expected less than 1",
        ),
        (
            FLIGHT + "[live_calibration]\ndrift = { tilt_rad = 1 }\n",
            "x.toml: live_calibration.drift.tilt_rad: unknown key",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_sentence(text, sentence):
    with pytest.raises(ConfigError) as caught:
        parsed(text)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)
