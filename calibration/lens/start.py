"""A first guess at a camera and at where it sees its boards, from nothing but the corners."""

from typing import Final

import cv2
import numpy as np

from aerodft.geometry.lens import rays_from_pixels
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera, LensModel
from calibration.lens.adjustment import Bundle, residuals_px, with_coefficients
from calibration.lens.views import Corners

_FOCALS: Final = np.geomspace(0.25, 8.0, 16)
"""Of the image's longer side: from a fisheye of 180 degrees to a tele lens of 7."""

_WIDEST: Final = np.cos(np.radians(75.0))
"""Rays farther from the axis are left out of a board's first pose: they hardly meet a plane in front of the camera."""

_FEWEST = 4  # corners that give a pose


def camera_guess(lens: LensModel, size_px: tuple[int, int], focal_px: float, coefficients: int) -> Camera:
    """An undistorted camera that looks through the image's centre, with so many coefficients of 0."""
    width, height = size_px
    camera = Camera(
        name="guess",
        width_px=width,
        height_px=height,
        fx_px=focal_px,
        fy_px=focal_px,
        cx_px=(width - 1) / 2,
        cy_px=(height - 1) / 2,
        lens=lens,
    )
    return with_coefficients(camera, coefficients)


def first_guesses(corners: Corners, lens: LensModel, size_px: tuple[int, int], coefficients: int) -> list[Bundle]:
    """Bundles to begin with, the best first; empty where no focal length sees all boards.

    Args:
        corners: What was seen.
        lens: Brown or fisheye.
        size_px: Width and height of the images.
        coefficients: Of the distortion; all are 0 in the guesses.
    """
    found = []
    for share in _FOCALS:
        guess = resected(camera_guess(lens, size_px, share * max(size_px), coefficients), corners)
        if guess is not None:
            found.append((float(np.sum(residuals_px(guess, corners) ** 2)), guess))
    found.sort(key=lambda each: each[0])
    return [guess for squares, guess in found if np.isfinite(squares)]


def resected(camera: Camera, corners: Corners) -> Bundle | None:
    """Where a camera sees its boards; None where it cannot see one of them."""
    rays = rays_from_pixels(camera, corners.pixels_px)
    rotations, translations = [], []
    for rows in np.split(np.arange(len(rays)), corners.starts[1:]):
        pose = _pose(rays[rows], corners.points_m[rows])
        if pose is None:
            return None
        rotations.append(pose[0])
        translations.append(pose[1])
    return Bundle(camera, np.array(rotations), np.array(translations))


def _pose(rays: FloatArray, points_m: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    ahead = rays[:, 2] > _WIDEST * np.linalg.norm(rays, axis=-1)  # no answer is not ahead either
    if np.count_nonzero(ahead) < _FEWEST:
        return None
    seen, places = rays[ahead, :2] / rays[ahead, 2:], points_m[ahead]
    middle = places.mean(axis=0)
    try:
        solved, turn, move = cv2.solvePnP(places - middle, seen, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    except cv2.error:  # corners along one line
        return None
    if not solved or not np.all(np.isfinite(turn)):
        return None
    rotation = np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64)
    return rotation, np.asarray(move[:, 0] - rotation @ middle, dtype=np.float64)


def reseated(bundle: Bundle, corners: Corners) -> Bundle:
    """The bundle with better poses where a board was taken for its mirror image in depth, as small ones are."""
    other = resected(bundle.camera, corners)
    if other is None:
        return bundle
    squares = [corners.per_view(np.sum(residuals_px(each, corners) ** 2, axis=-1)) for each in (bundle, other)]
    better = squares[1] < squares[0]
    return Bundle(
        bundle.camera,
        np.where(better[:, None, None], other.rotations, bundle.rotations),
        np.where(better[:, None], other.translations_m, bundle.translations_m),
    )
