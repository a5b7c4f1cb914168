"""Kinds of probes that nobody here has heard of: the mean slant range of some points, refused where they lie apart.

And the perimeter of a polygon, which states nothing but scalar and gradient.
"""

import math

import numpy as np
import orjson
import pytest
from numpy.testing import assert_allclose

import aerodft
from aerodft import probe
from aerodft.adapters.config.station import load_station
from aerodft.adapters.wire.requests import parse_measure_request
from aerodft.app.viewing import kinds_document, probe_of
from aerodft.cli.scenes.image_options import Stds, parse_probes
from aerodft.dft import PROBE_KINDS, Gradient, Kind, Refusal, Request, Setup
from aerodft.geometry import camera_pose
from aerodft.model import Camera, PoseSample, PoseStd, Probe, ProbeKind, Status
from tests.one_image import measure
from tests.truth.scenes import as_pixels

from .perimeter import KIND, PERIMETER

MEAN_RANGE = ProbeKind("mean-range")
CAMERA = Camera.from_fov(name="c", width_px=1920, height_px=1080, hfov_rad=1.1, vfov_rad=0.66)
STD = PoseStd(height_agl_m=0.5, tilt_rad=0.005)
NEAR, FAR = ((900.0, 900.0), (960.0, 950.0), (1000.0, 1000.0)), ((900.0, 1000.0), (960.0, 10.0))


def away_of(geometry):
    away = geometry.points_enu_m - geometry.camera_enu_m[..., None, :]
    return away, np.linalg.norm(away, axis=-1)


def mean_range(geometry):
    return away_of(geometry)[1].mean(axis=-1)


def mean_range_gradient(geometry):
    away, range_m = away_of(geometry)
    by_points = away / range_m[..., None] / away.shape[-2]
    return Gradient(-by_points.sum(axis=-2), np.zeros_like(geometry.directions_enu), by_points)


class MeanRange(Kind):
    def refusals(self, found):
        spread_m = np.ptp(away_of(found.geometry)[1], axis=-1)
        yield Refusal(spread_m > found.value / 2, Status.ILL_CONDITIONED, "the ranges differ by {:.0f} m", spread_m)


@pytest.fixture(autouse=True)
def mean_range_kind(monkeypatch):
    kind = MeanRange(name=MEAN_RANGE, pixels=(2, 9), scalar=mean_range, gradient=mean_range_gradient)
    monkeypatch.setitem(PROBE_KINDS, MEAN_RANGE, kind)


def measured(*probes):
    pose = camera_pose(height_agl_m=40.0, heading_rad=0.4, tilt_rad=1.0, roll_rad=0.0, std=STD)
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=pose, std=STD)
    requests = [
        Request(probe=Probe(name=f"{kind}-{number}", kind=kind, pixels=pixels), pixels=pixels, std_px=1.0)
        for number, (kind, pixels) in enumerate(probes)
    ]
    return measure(Setup(camera=CAMERA), sample, requests)


def test_a_kind_from_outside_is_measured():
    (mean, *single) = measured((MEAN_RANGE, NEAR), *((ProbeKind.RANGE, (pixel,)) for pixel in NEAR))
    assert (mean.status, mean.kind, mean.unit, len(mean.enu_m)) == (Status.OK, MEAN_RANGE, "m", 3)
    assert_allclose(mean.value, np.mean([each.value for each in single]))
    stds = [each.std for each in single]
    assert min(stds) / 2 < mean.std < max(stds)


def test_what_it_refuses_has_its_reason():
    (found,) = measured((MEAN_RANGE, FAR))
    assert (found.status, found.value) == (Status.ILL_CONDITIONED, None)
    assert found.reasons[0].startswith("the ranges differ by ")


def test_how_many_pixels_it_takes_is_checked_where_it_is_measured_and_where_it_is_asked():
    with pytest.raises(ValueError, match="1 pixels, mean-range needs 2 to 9"):
        measured((MEAN_RANGE, NEAR[:1]))
    request = parse_measure_request(b'{"kind": "mean-range", "pixels": [[900, 900], [960, 950]]}', {})
    assert request.probe.kind == MEAN_RANGE


@pytest.fixture
def perimeter_kind(monkeypatch):
    monkeypatch.setitem(PROBE_KINDS, PERIMETER, KIND)


@pytest.mark.usefixtures("perimeter_kind")
@pytest.mark.parametrize("radius_px", [40, 80, 300])
def test_a_kind_of_scalar_and_gradient_alone_holds_the_truth_under_noise_of_its_pixels(radius_px):
    """Without its noise bias taken off, an interval never holds the truth: 41 sides are 0.13 to 0.7 m too long."""
    noise_px, corners, rng = 1.5, 41, np.random.default_rng(radius_px)
    turn = 2 * math.pi * np.arange(corners) / corners
    pixels = np.array([960, 560]) + radius_px * np.stack([np.cos(turn), 0.7 * np.sin(turn)], axis=-1)
    x, y = ((pixels - [CAMERA.cx_px, CAMERA.cy_px]) / [CAMERA.fx_px, CAMERA.fy_px]).T
    down, ahead = math.cos(0.5) + y * math.sin(0.5), math.sin(0.5) - y * math.cos(0.5)
    ground_m = 40.0 * np.stack([x, ahead], axis=-1) / down[:, None]
    truth_m = np.sum(np.hypot(*(np.roll(ground_m, -1, axis=0) - ground_m).T))
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=camera_pose(height_agl_m=40.0, tilt_rad=0.5))
    noisy = [as_pixels(pixels + noise_px * rng.standard_normal(pixels.shape)) for _ in range(150)]
    requests = [
        Request(probe=Probe(name="p", kind=PERIMETER, pixels=each), pixels=each, std_px=noise_px) for each in noisy
    ]
    found = measure(Setup(camera=CAMERA), sample, requests)
    assert np.mean([each.ci95[0] <= truth_m <= each.ci95[1] for each in found]) >= 0.93
    assert abs(np.mean([each.value for each in found]) - truth_m) < 0.25 * found[0].std


@pytest.mark.usefixtures("perimeter_kind")
def test_a_kind_from_outside_is_asked_for_through_every_door(tmp_path):
    pixels = [[900, 900], [960, 950], [1000, 900]]
    (request,) = parse_probes(["perimeter 900,900 960,950 1000,900"], Stds(), 0.0)
    station = '[station]\nname = "s"\n[camera]\nname = "c"\nwidth_px = 1920\nheight_px = 1080\nhfov_deg = 60\n'
    station += "[pose]\nheight_agl_m = 9.0\ntilt_deg = 30.0\n"
    station += f'[[probe]]\nname = "p"\nkind = "perimeter"\npixels = {pixels}\n'
    (tmp_path / "station.toml").write_text(station)
    asked = [
        request.probe,
        probe("perimeter", pixels),
        aerodft.Perimeter(pixels),
        probe_of({"kind": "perimeter", "pixels": pixels}, 1.0, dict),
        parse_measure_request(orjson.dumps({"kind": "perimeter", "pixels": pixels}), {}).probe,
        load_station(tmp_path / "station.toml").pipeline.probes[0],
    ]
    assert kinds_document()["perimeter"] == {"least": 3, "most": 256, "closed": True}
    assert all(each.kind == PERIMETER and each.pixels == as_pixels(pixels) for each in asked)
