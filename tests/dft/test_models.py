"""The parts of the difference between the models, from geometry written out here."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from aerodft.dft import Request, Setup
from aerodft.dft.paper import compare_models
from aerodft.dft.paper.models import right_by_geometry
from aerodft.geometry import camera_pose
from aerodft.model import Camera, PoseSample, Probe, ProbeKind, Status

# Half a degree wide: angles are linear in pixels to 1e-5 of themselves, so all of the difference is Eq. 5.
NARROW = Camera(
    name="narrow", width_px=1000, height_px=800, fx_px=1e5, fy_px=1e5, cx_px=500.0, cy_px=400.0
)  # fmt: skip


@given(
    height=st.floats(1, 100),
    tilt=st.floats(0, 1.2),
    across=st.floats(-0.6, 0.6),
    up=st.floats(-0.3, 0.3),
)
def test_right_by_geometry_is_the_rays_x(height, tilt, across, up):
    """A ray (tan phi, tan(psi - theta), 1) in camera axes, met with the ground."""
    right = math.tan(across)
    forward = math.cos(tilt) - math.sin(tilt) * math.tan(up)  # downwards, per unit along the optical axis
    found = right_by_geometry(height, tilt, tilt + up, across)
    assert_allclose(found, height * right / forward, rtol=1e-9, atol=1e-12)


def test_right_by_geometry_misses_above_the_horizon():
    assert np.isnan(right_by_geometry(10.0, 1.5, np.array([1.58, 3.0]), 0.1)).all()


@given(tilt_deg=st.floats(0, 80), i=st.floats(0, 999), j=st.floats(0, 799))
def test_with_a_narrow_view_all_of_the_difference_is_equation_5(tilt_deg, i, j):
    pose = camera_pose(height_agl_m=50.0, tilt_rad=math.radians(tilt_deg), heading_rad=2.0, east_m=7.0)
    probe = Probe(name="p", kind=ProbeKind.RANGE, pixels=((i, j),))
    sample = PoseSample(stamp_ns=0, status=Status.OK, pose=pose)
    (found,) = compare_models(Setup(camera=NARROW), sample, (Request(probe=probe, pixels=probe.pixels, std_px=0.0),))
    assert_allclose(found.angles_m, [[0.0, 0.0]], atol=50.0 / math.cos(math.radians(tilt_deg)) ** 2 * 1e-6)
    assert_allclose(found.value, found.dft.value - found.pinhole.value, atol=1e-12)


def test_without_a_pose_there_is_no_difference():
    probe = Probe(name="p", kind=ProbeKind.RANGE, pixels=((1.0, 1.0),))
    sample = PoseSample(stamp_ns=0, status=Status.NO_HEIGHT)
    (found,) = compare_models(Setup(camera=NARROW), sample, (Request(probe=probe, pixels=probe.pixels, std_px=0.0),))
    assert (found.value, found.ground_m, found.pinhole.status) == (None, None, Status.NO_HEIGHT)
