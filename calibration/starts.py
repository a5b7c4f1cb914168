"""Where to start from, so that nobody has to guess: every way in which the evidence alone places the camera."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from aerodft.geometry.lens import rays_from_pixels
from aerodft.geometry.rotation import camera_angles, camera_attitude
from aerodft.model.arrays import FloatArray
from aerodft.model.measurement import ProjectionModel
from calibration.residuals import Problem
from calibration.state import State

_FEWEST = 3  # landmarks that place a camera without a guess; three do so in up to four ways
_FLAT = 0.2  # thickness of a body of points, as a share of its width, below which it may be taken for its mirror image
_TILTS_RAD = np.radians([8.0, 35.0, 55.0, 70.0, 82.0, 95.0])
_HEADINGS_RAD = np.radians(np.arange(0.0, 360.0, 45.0))
_HEIGHTS_M = (2.0, 6.0, 20.0, 60.0, 200.0)
_ZOOMS = (1.0, 0.5, 0.7, 1.4, 2.0)
_ANGLES = ("tilt", "roll", "heading")


def placed(problem: Problem, given: State, rows: npt.NDArray[np.int64] | None = None) -> Iterator[State]:
    """What landmarks say in closed form, for some focal lengths if it is unknown.

    Three by P3P, more by SQPnP (Terzakis and Lourakis, 2020); a plane's two poses by IPPE (Collins and Bartoli, 2014).

    Args:
        problem: The evidence.
        given: What is known or guessed.
        rows: Indices of the landmarks to use; None for all.
    """
    points, pixels = problem.landmarks
    if rows is not None:
        points, pixels = points[rows], pixels[rows]
    if len(points) < _FEWEST or given.model is not ProjectionModel.PINHOLE:
        return
    middle = points.mean(axis=0)
    zooms = _ZOOMS if {"focal", "fx"} & set(problem.unknowns.names) else (1.0,)
    for zoom in zooms:
        lens = replace(given.camera, fx_px=zoom * given.camera.fx_px, fy_px=zoom * given.camera.fy_px)
        rays = rays_from_pixels(lens, pixels)
        ahead = rays[:, 2] > 0.05  # noqa: PLR2004 - 3 degrees within a fisheye's half space
        if np.count_nonzero(ahead) < _FEWEST:
            continue
        flat = np.ascontiguousarray(rays[ahead, :2] / rays[ahead, 2:])
        for turn, shift in _closed_forms(points[ahead] - middle, flat):
            enu_r_cam = np.asarray(cv2.Rodrigues(turn)[0].T, dtype=np.float64)
            eye = middle - (enu_r_cam @ shift).ravel()
            if np.all(np.isfinite(eye)):
                yield _only_unknown(problem, given, replace(given, camera=lens), eye, enu_r_cam)


def _closed_forms(points_m: FloatArray, flat: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Rotations and shifts from the world to the camera: all that fit, points of a plane may fit two."""
    ways = [cv2.SOLVEPNP_P3P] if len(flat) == _FEWEST else [cv2.SOLVEPNP_SQPNP]
    _, thickness, axes = np.linalg.svd(points_m, full_matrices=False)
    in_plane = points_m
    if len(flat) > _FEWEST and thickness[2] < _FLAT * thickness[1]:
        ways.append(cv2.SOLVEPNP_IPPE)
        in_plane = points_m - np.outer(points_m @ axes[2], axes[2])
    for way in ways:
        try:
            if way == cv2.SOLVEPNP_P3P:
                _, turns, shifts = cv2.solveP3P(points_m, flat, np.eye(3), None, way)
            else:
                world = in_plane if way == cv2.SOLVEPNP_IPPE else points_m
                _, turns, shifts, *_ = cv2.solvePnPGeneric(world, flat, np.eye(3), None, flags=way)
        except cv2.error:  # points in a line, or all in one
            continue
        yield from zip(turns, shifts, strict=True)


def _only_unknown(problem: Problem, given: State, guess: State, eye_m: FloatArray, rotation: FloatArray) -> State:
    """The guess, with what is known as it is known."""
    names = problem.unknowns.names
    angles = _angles_of(rotation)
    known = camera_angles(given.wxyz)
    tilt, roll, heading = (
        angles[index] if name in names else float(known[index]) for index, name in enumerate(_ANGLES)
    )
    position = given.position_m.copy()
    for index, name in enumerate(("east", "north", "height")):
        if name in names:
            position[index] = eye_m[index]
    position[2] = max(position[2], given.elevation_m + 0.1)
    return replace(guess, position_m=position, wxyz=camera_attitude(tilt, roll, heading))


def _angles_of(rotation: FloatArray) -> tuple[float, float, float]:
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to load, and rarely needed

    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    tilt, roll, heading = camera_angles(np.array([w, x, y, z]))
    return float(tilt), float(roll), float(heading)


def scattered(problem: Problem, given: State) -> Iterator[State]:
    """A net of tilts, headings and heights over everything that a camera above ground could be."""
    names, priors = set(problem.unknowns.names), problem.known.priors
    tilt, roll, heading = (float(angle) for angle in camera_angles(given.wxyz))
    free = names - set(priors)
    tilts = _TILTS_RAD if "tilt" in free else [tilt]
    headings = _HEADINGS_RAD if "heading" in free else [heading]
    heights = [given.elevation_m + height for height in _HEIGHTS_M] if "height" in free else [given.position_m[2]]
    for one_tilt, one_heading, height in itertools.product(tilts, headings, heights):
        position = np.array([*given.position_m[:2], height])
        state = replace(given, position_m=position, wxyz=camera_attitude(one_tilt, roll, one_heading))
        yield _above_landmarks(problem, state) if {"east", "north"} & free else state


def _above_landmarks(problem: Problem, state: State) -> State:
    """The state, moved to where its landmarks' middle is seen at their pixels' middle."""
    points, pixels = problem.landmarks
    if not len(points):
        return state
    ray = state.rotation @ rays_from_pixels(state.camera, pixels.mean(axis=0))
    middle = points.mean(axis=0)
    below = float(middle[2] - state.position_m[2])
    reach = min(below / ray[2], 20 * abs(below)) if below < 0 and ray[2] < 0 else 5 * max(abs(below), 1.0)
    if not math.isfinite(reach):
        return state
    position = state.position_m.copy()
    for index, name in enumerate(("east", "north")):
        if name in problem.unknowns.names:
            position[index] = middle[index] - reach * ray[index]
    return replace(state, position_m=position)
