"""Rotations over a plane: against exact homographies, Monte-Carlo, rendered images, and water that flows."""

import math

import numpy as np
import pytest

from aerodft.geometry import from_rotation_vector, inverse, matrix, multiply, to_rotation_vector
from aerodft.sim import Waypoint, default_camera, fly
from aerodft.sim.render import Renderer
from aerodft.sim.world import DEFAULT_ORIGIN, River, furnished_world
from aerodft.vision.camera_motion import (
    ImagePair,
    PlaneMotion,
    PlaneTracker,
    layered_motion,
    plane_motion,
    turns_over_plane,
)

from ..calibration.sync_views import seen_pair  # noqa: TID252 - test folders are no packages that could be named


def turning(tilt_deg=30.0, *, seconds=4.0):
    """From one place and view to another."""
    ends = ((0.0, 0.0, 40.0, 0.2, math.radians(tilt_deg - 90), 0.0), (6.0, 9.0, 43.0, 0.8, -1.2, 0.1))
    waypoints = tuple(
        Waypoint(
            time_s=seconds * index,
            east_m=east,
            north_m=north,
            height_m=height,
            heading_rad=heading,
            gimbal_pitch_rad=pitch,
            gimbal_yaw_rad=yaw,
        )
        for index, (east, north, height, heading, pitch, yaw) in enumerate(ends)
    )
    return fly(waypoints, origin=DEFAULT_ORIGIN)


def truth(trajectory, starts_ns, ends_ns):
    """Turns and normals ``(n, 3)``."""
    first, second = trajectory.at(starts_ns).enu_wxyz_cam, trajectory.at(ends_ns).enu_wxyz_cam
    return to_rotation_vector(multiply(inverse(first), second)), matrix(first)[:, 2, :]


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 70.0])
def test_an_exact_homography_gives_its_rotation_back(tilt_deg):
    rng = np.random.default_rng(3)
    turn = 0.1 * rng.standard_normal((5, 3))
    normal = np.tile([0.0, -math.sin(math.radians(tilt_deg)), -math.cos(math.radians(tilt_deg))], (5, 1))
    shift = 0.05 * rng.standard_normal((5, 3))
    whole = matrix(inverse(from_rotation_vector(turn))) + shift[:, :, None] * normal[:, None, :]
    motion = PlaneMotion(
        start_ns=np.arange(5),
        end_ns=np.arange(5) + 1,
        homography=whole / whole[:, 2, 2, None, None],
        cov=np.tile(1e-6 * np.eye(8), (5, 1, 1)),
    )
    found = turns_over_plane(motion, normal, np.zeros((5, 3)))
    np.testing.assert_allclose(found.rotvec_rad, turn, atol=1e-9)
    np.testing.assert_allclose(found.chi2, 0.0, atol=1e-9)


def test_stated_covariances_are_those_of_many_draws():
    trajectory, rng = turning(), np.random.default_rng(1)
    moments = np.array([2_000_000_000, 2_200_000_000]) + trajectory.start_ns
    earlier, later = (trajectory.at([moment]) for moment in moments)
    pairs = [ImagePair(start_ns=0, end_ns=1, matches=seen_pair(earlier, later, rng, noise_px=0.15)) for _ in range(300)]
    turn, normal = truth(trajectory, moments[:1], moments[1:])
    found = turns_over_plane(plane_motion(pairs), np.repeat(normal, 300, axis=0), np.repeat(turn, 300, axis=0))
    z = np.linalg.solve(np.linalg.cholesky(found.cov_rad2), (found.rotvec_rad - turn)[..., None])[..., 0]
    np.testing.assert_allclose(np.std(z, axis=0), 1.0, atol=0.2)
    assert np.all(np.abs(np.mean(z, axis=0)) < 0.25)
    assert 1.0 < np.mean(found.chi2) < 3.5  # 2 degrees of freedom


def test_land_and_flowing_water_are_told_apart():
    trajectory, rng = turning(), np.random.default_rng(2)
    starts = trajectory.start_ns + np.arange(10, 30) * 100_000_000
    ends = starts + 200_000_000
    pairs = [
        ImagePair(
            start_ns=start,
            end_ns=end,
            matches=seen_pair(trajectory.at([start]), trajectory.at([end]), rng, count=300, flow_m=(0.12, 0.1, 0.0)),
        )
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True)
    ]
    turn, normal = truth(trajectory, starts, ends)
    about = turn + 0.002 * rng.standard_normal(turn.shape)
    motion = layered_motion(pairs, about, normal)
    assert len(motion) >= 1.8 * len(pairs)  # both were found in nearly all
    turn, normal = truth(trajectory, motion.start_ns, motion.end_ns)
    apart = np.linalg.norm(turns_over_plane(motion, normal, turn).rotvec_rad - turn, axis=-1)
    together = plane_motion(pairs)
    turn, normal = truth(trajectory, together.start_ns, together.end_ns)
    mixed = np.linalg.norm(turns_over_plane(together, normal, turn).rotvec_rad - turn, axis=-1)
    assert np.median(apart) < math.radians(0.06)
    assert np.median(apart) < np.median(mixed)


def test_rendered_images_tell_how_the_camera_turned():
    camera, trajectory = default_camera(960, 540), turning()
    renderer = Renderer(camera, furnished_world(River(origin_en_m=(0.0, -60.0)), seed=2))
    tracker = PlaneTracker(camera)
    for stamp_ns in range(trajectory.start_ns, trajectory.end_ns, 200_000_000):
        pixels = renderer.render(trajectory.pose(stamp_ns), (stamp_ns - trajectory.start_ns) / 1e9)
        tracker.add(stamp_ns, lambda pixels=pixels: pixels)
    motion = plane_motion(tracker.pairs)
    turn, normal = truth(trajectory, motion.start_ns, motion.end_ns)
    assert len(motion) >= 18
    off = turns_over_plane(motion, normal, turn).rotvec_rad - turn
    assert np.all(np.median(np.abs(off), axis=0) < math.radians(0.05))  # of turns of up to 2 degrees


def test_images_without_texture_give_no_pair():
    tracker = PlaneTracker(default_camera(640, 360))
    for stamp_ns in range(0, 3_000_000_000, 200_000_000):
        tracker.add(stamp_ns, lambda: np.full((360, 640, 3), 90, dtype=np.uint8))
    assert len(plane_motion(tracker.pairs)) == 0
