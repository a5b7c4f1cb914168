"""Where to start from, so that nobody has to guess: every way in which the evidence alone places the camera."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from aerodft.geometry.lens import rays_from_pixels
from aerodft.geometry.rotation import camera_attitude, from_rotation_vector, inverse, matrix
from aerodft.model.arrays import FloatArray
from aerodft.model.measurement import ProjectionModel
from calibration.residuals import Problem
from calibration.state import State

_FEWEST = 3  # landmarks that place a camera without a guess; three do so in up to four ways
_FLAT = 0.2  # thickness of a body of points, as a share of its width, below which it may be taken for its mirror image
_SAME = 0.005  # of rotations and of shares of a distance: two closed forms of one pose, which descents bring together
_WORSE, _NEAR = 30.0, 0.02  # than a better closed form, and in focal lengths: what is farther off is no mirror image
_TILTS_RAD = np.radians([8.0, 35.0, 55.0, 70.0, 82.0, 95.0])
_HEADINGS_RAD = np.radians(np.arange(0.0, 360.0, 45.0))
_HEIGHTS_M = (2.0, 6.0, 20.0, 60.0, 200.0)
_ZOOMS = (1.0, 0.5, 0.7, 1.4, 2.0)
_ANGLES = ("tilt", "roll", "heading")


def zooms(problem: Problem) -> tuple[float, ...]:
    """What to multiply the given focal length with, if it is unknown."""
    return _ZOOMS if {"focal", "fx"} & set(problem.unknowns.names) else (1.0,)


def placed(
    problem: Problem, given: State, zoom: float = 1.0, rows: npt.NDArray[np.int64] | None = None
) -> Iterator[State]:
    """What landmarks say in closed form of a camera with known focal length.

    Three by P3P, more by SQPnP (Terzakis and Lourakis, 2020); a plane's two poses by IPPE (Collins and Bartoli, 2014).

    Args:
        problem: The evidence.
        given: What is known or guessed.
        zoom: Of ``zooms``.
        rows: Indices of the landmarks to use; None for all.
    """
    points, pixels = problem.landmarks
    if rows is not None:
        points, pixels = points[rows], pixels[rows]
    if len(points) < _FEWEST or given.model is not ProjectionModel.PINHOLE:
        return
    middle = points.mean(axis=0)
    lens = replace(given.camera, fx_px=zoom * given.camera.fx_px, fy_px=zoom * given.camera.fy_px)
    rays = rays_from_pixels(lens, pixels)
    ahead = rays[:, 2] > 0.05  # noqa: PLR2004 - 3 degrees within a fisheye's half space
    if np.count_nonzero(ahead) < _FEWEST:
        return
    flat = np.ascontiguousarray(rays[ahead, :2] / rays[ahead, 2:])
    found: list[FloatArray] = []
    for turn, shift in _closed_forms(points[ahead] - middle, flat):
        wxyz = inverse(from_rotation_vector(turn.ravel()))
        enu_r_cam = matrix(wxyz)
        away = (enu_r_cam @ shift).ravel()
        pose = np.column_stack([enu_r_cam, away / np.linalg.norm(away), np.log(np.linalg.norm(away)) * np.ones(3)])
        is_new = all(np.max(np.abs(pose - other)) > _SAME for other in found)
        if is_new and np.all(np.isfinite(pose)):
            found.append(pose)
            yield _only_unknown(problem, given, replace(given, camera=lens), middle - away, wxyz)


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
                errors: npt.ArrayLike = np.zeros(len(turns))
            else:
                world = in_plane if way == cv2.SOLVEPNP_IPPE else points_m
                _, turns, shifts, errors = cv2.solvePnPGeneric(world, flat, np.eye(3), None, flags=way)
        except cv2.error:  # points in a line, or all in one
            continue
        if not turns:  # without poses OpenCV gives no errors either
            continue
        off = np.asarray(errors, dtype=np.float64).ravel()
        near = off <= max(_WORSE * float(np.min(off, initial=np.inf)), _NEAR)
        for turn, shift, is_near in zip(turns, shifts, near, strict=True):
            if is_near:
                yield np.asarray(turn, dtype=np.float64), np.asarray(shift, dtype=np.float64)


def _only_unknown(problem: Problem, given: State, guess: State, eye_m: FloatArray, wxyz: FloatArray) -> State:
    """The guess, with what is known as it is known."""
    names = problem.unknowns.names
    placed_rad = replace(guess, wxyz=wxyz).angles_rad
    tilt, roll, heading = (
        (placed_rad if name in names else given.angles_rad)[index] for index, name in enumerate(_ANGLES)
    )
    position = given.position_m.copy()
    for index, name in enumerate(("east", "north", "height")):
        if name in names:
            position[index] = eye_m[index]
    position[2] = max(position[2], given.elevation_m + 0.1)
    return replace(guess, position_m=position, wxyz=camera_attitude(tilt, roll, heading))


def scattered(problem: Problem, given: State) -> Iterator[State]:
    """A net of tilts, headings and heights over everything that a camera above ground could be."""
    names, priors = set(problem.unknowns.names), problem.known.priors
    tilt, roll, heading = given.angles_rad
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
