"""Whether views determine a lens, and in a sentence what to add where they do not."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from aerodft.errors import NoAnswerError
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import LensModel
from calibration.lens.adjustment import Bundle, intrinsics_of
from calibration.lens.start import camera_guess, resected
from calibration.lens.views import Corners, View

FEWEST_VIEWS: Final = 4
"""Three would do for a pinhole without noise; with four the residuals begin to say how good the corners are."""

_PARALLEL_DEG, _LEAST_TURN_DEG = 3.0, 10.0  # between the boards that are turned most: by an assumed lens, and the found
_MOST_FOCAL_STD = 0.01  # share of the focal length
_MOST_CENTRE_STD = 0.02  # share of the image's longer side

_ADD = "hold the board tilted by 30 to 45 deg to the left, right, top and bottom, near and far, and in every corner"


def check_before(views: Sequence[View], size_px: tuple[int, int]) -> None:
    """Refuse views that are too few, or all of boards that lie parallel to each other.

    Judged with an assumed lens: with boards that are parallel, an adjusted focal length could be anything.

    Raises:
        NoAnswerError: Says what to add.
    """
    if len(views) < FEWEST_VIEWS:
        got = f"{len(views)} usable view{'' if len(views) == 1 else 's'} of the board"
        expected = f"{FEWEST_VIEWS}, better 15"
        raise NoAnswerError("too few views to determine the lens", got=got, expected=expected, hint=_ADD)
    if largest_turn_rad(normals(views, size_px)) < math.radians(_PARALLEL_DEG):
        raise _too_similar("boards that lie parallel to each other")


def check_after(bundle: Bundle, cov: FloatArray) -> None:
    """Refuse a camera whose boards were hardly turned, or whose focal length or principal point is hardly known.

    Args:
        bundle: The adjusted camera, and where it sees the boards.
        cov: Of its intrinsics, in the order of ``intrinsics_of``.

    Raises:
        NoAnswerError: Says which, and what to add.
    """
    turn_deg = math.degrees(largest_turn_rad(bundle.rotations[:, :, 2]))
    if turn_deg < _LEAST_TURN_DEG:
        raise _too_similar(f"boards that are turned by at most {turn_deg:.1f} deg from each other")
    _check_well_known(bundle, cov)


def _too_similar(got: str) -> NoAnswerError:
    what = "the views are too similar to tell focal length from distance"
    return NoAnswerError(what, got=got, expected=f"turned by {_LEAST_TURN_DEG:.0f} deg, better 40", hint=_ADD)


def normals(views: Sequence[View], size_px: tuple[int, int]) -> FloatArray:
    """``(v, 3)`` normals of the boards in camera axes, roughly: for a lens of about 55 degrees."""
    guess = resected(camera_guess(LensModel.BROWN, size_px, float(max(size_px)), 0), Corners.of(views))
    return np.tile([0.0, 0.0, 1.0], (len(views), 1)) if guess is None else guess.rotations[:, :, 2]


def largest_turn_rad(facing: FloatArray) -> float:
    """Largest angle between two of the boards with normals ``(v, 3)``."""
    facing = facing * np.where(facing[:, 2:] < 0, -1.0, 1.0)  # a chessboard may be counted from either end
    return float(np.arccos(np.clip(np.min(facing @ facing.T), -1.0, 1.0)))


def _check_well_known(bundle: Bundle, cov: FloatArray) -> None:
    camera, std = bundle.camera, np.sqrt(np.diag(cov))
    focal = float(np.max(std[:2] / intrinsics_of(camera)[:2]))
    if not focal <= _MOST_FOCAL_STD:
        got = f"{camera.fx_px:.5g} px, known to {100 * focal:.2g} %" if math.isfinite(focal) else "no answer"
        expected = f"a std of at most {100 * _MOST_FOCAL_STD:g} %"
        raise NoAnswerError("the views hardly determine the focal length", got=got, expected=expected, hint=_ADD)
    longer = max(camera.width_px, camera.height_px)
    if not float(np.max(std[2:4])) <= _MOST_CENTRE_STD * longer:
        got = f"a std of {float(np.max(std[2:4])):.3g} px"
        expected = f"at most {_MOST_CENTRE_STD * longer:.2g} px"
        raise NoAnswerError("the views hardly determine the principal point", got=got, expected=expected, hint=_ADD)
