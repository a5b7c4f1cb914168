"""Measurements of flights whose video's clock was found are wrong by as much as their stds say.

Each flight draws its own clock, lag and biases. The station states a doubt of 0.6 s in time, as for a start in whole
seconds. The alignment replaces it: with both, stds of a surveying flight would be 2.2 times too wide.
"""

import math
import tomllib

import numpy as np
import orjson
import pytest
import tomli_w

from aerodft import import_flight, load_camera
from aerodft.adapters.config.camera import camera_document
from aerodft.geometry import matrix, rays_from_pixels
from replay.recordings import Recording

from ..calibration.sync_flights import (  # noqa: TID252 - test folders are no packages that could be named
    Clocks,
    scenario,
    wandering,
    write_clip,
    write_log,
)

pytestmark = pytest.mark.nightly

SEEDS = tuple(range(1, 16, 2))
CLIP_S, MARGIN_S, SIZE = 45.0, 10.0, (320, 180)
STATION = """
[station]
name = "synced"
[camera]
file = "camera.toml"
[telemetry.height]
order = ["home"]
std_m = { home = 0.5 }
[telemetry.attitude]
tilt_std_deg = 0.7
pan_std_deg = 0.5
roll_std_deg = 0.5
heading_std_deg = 2.0
[images]
video = "video.mp4"
time_offset_s = "auto"
time_std_s = 0.6
[record]
image_hz = 0
[[probe]]
name = "across"
kind = "distance"
pixels = [[60.0, 120.0], [260.0, 120.0]]
"""


def normalized_errors(folder, seed):
    """The clock's error over its std, and the errors of the widths over theirs."""
    drawn = Clocks.drawn(seed)
    clocks = Clocks(offset_s=0.03 * drawn.offset_s, drift=0.1 * drawn.drift, lag_s=drawn.lag_s)
    trajectory = wandering(seed, CLIP_S + 2 * MARGIN_S)
    told = scenario(trajectory, seed, clocks, margin_s=MARGIN_S, size=SIZE, fps=8.0)
    write_log(told, folder / "flight.tlog")
    (folder / "camera.toml").write_text(tomli_w.dumps(camera_document(told.camera)))
    (folder / "station.toml").write_text(STATION)
    write_clip(told, clocks, folder / "video.mp4")
    import_flight(folder / "flight.tlog", station=folder / "station.toml", output=folder / "rec")
    images = tomllib.loads((folder / "rec" / "config.toml").read_text())["images"]
    camera = load_camera(folder / "camera.toml")
    errors = []
    for line in Recording(folder / "rec").measurements():
        width = orjson.loads(line)
        if width["status"] == "ok":
            at = trajectory.at([int(told.image_stamps_ns[width["image"]])])
            rays = rays_from_pixels(camera, np.array(width["pixels"])) @ matrix(at.enu_wxyz_cam)[0].T
            ground = rays * (-at.position_enu_m[0, 2] / rays[:, 2:])
            errors.append((width["value"] - math.dist(*ground[:, :2])) / width["std"])
    return images["time_std_s"], np.array(errors)


def test_widths_of_synced_flights_are_off_by_what_they_state(tmp_path):
    mean_squares, worst = [], 0.0
    for seed in SEEDS:
        folder = tmp_path / str(seed)
        folder.mkdir()
        time_std_s, errors = normalized_errors(folder, seed)
        assert time_std_s < 0.03, seed
        assert len(errors) > 200, seed
        mean_squares.append(np.mean(errors**2))
        worst = max(worst, np.max(np.abs(errors)))
    # A flight's errors are common to its widths: 8 flights give the ratio to about 25 % (one std).
    assert 0.5 < math.sqrt(np.mean(mean_squares)) < 1.5
    assert worst < 4
