"""A kind of probe that nobody here has heard of: the mean slant range of some points, refused where they lie apart."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from aerodft.adapters.wire.requests import parse_measure_request
from aerodft.dft import PROBE_KINDS, Gradient, Kind, Refusal, Request, Setup
from aerodft.geometry import camera_pose
from aerodft.model import Camera, PoseSample, PoseStd, Probe, ProbeKind, Status
from tests.one_image import measure

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
    request = parse_measure_request(b'{"kind": "mean-range", "pixels": [[900, 900], [960, 950]]}')
    assert request.probe.kind == MEAN_RANGE
