"""From views of a board to a camera with its covariance: model choice, outlying views, and refusals."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from aerodft.errors import NoAnswerError
from aerodft.model.arrays import FloatArray
from aerodft.model.camera import Camera, CameraStd, LensModel
from calibration.lens.adjustment import Bundle, adjust, covariance, residuals_px, with_coefficients
from calibration.lens.determined import check_after, check_before
from calibration.lens.outliers import view_rms_px, without_outliers
from calibration.lens.start import first_guesses, reseated
from calibration.lens.views import Corners, View

_STARTS = 3  # best guesses that are followed to their end


class LensChoice(StrEnum):
    """What a lens may be described by."""

    BROWN = "brown"
    RATIONAL = "rational"
    FISHEYE = "fisheye"


_FEWEST_COEFFICIENTS, _WITH_K3, _RATIONAL = 4, 5, 8
_RATIONAL_STD = 3.0  # of k4, k5, k6 before anything is seen: those of real lenses are about 1


@dataclass(frozen=True, slots=True, eq=False)
class LensSolution:
    """A calibrated lens.

    Attributes:
        camera: With its covariance.
        views: Those that it was solved from, without single corners that stray.
        corners: Of these views.
        bundle: The boards' poses in them.
        off_px: ``(n, 2)``: projected less seen.
        std_px: Of one coordinate of a corner, from the residuals.
        left_out: Views that disagree with all others, with the rms (px) that each had when it was left out.
        strays: How many single corners were left out of the views, by name.
        bic_gain: How much the Bayesian information criterion falls with k3 (brown, where it was kept if that is above
            0), or with k4, k5, k6 (rational); None for others.
    """

    camera: Camera
    views: tuple[View, ...]
    corners: Corners
    bundle: Bundle
    off_px: FloatArray
    std_px: float
    left_out: tuple[tuple[View, float], ...]
    strays: dict[str, int]
    bic_gain: float | None

    @property
    def rms_px(self) -> float:
        """Root mean square of the residuals' lengths."""
        return math.sqrt(float(np.mean(np.sum(self.off_px**2, axis=-1))))

    @property
    def view_rms_px(self) -> FloatArray:
        """``(v,)``, likewise."""
        return view_rms_px(self.off_px, self.corners)


def solve_lens(
    views: Sequence[View], size_px: tuple[int, int], lens: LensChoice = LensChoice.BROWN, *, name: str = "camera"
) -> LensSolution:
    """Calibrate a lens.

    Args:
        views: Views of one board by one camera in one mode.
        size_px: Width and height of the images.
        lens: What to describe it by; brown with k3 only where the Bayesian information criterion asks for it.
        name: The camera's.

    Raises:
        NoAnswerError: Views are too few or too similar to determine the lens; says what to add.
    """
    views = tuple(views)
    check_before(views, size_px)
    bundle = _begin(Corners.of(views), lens, size_px)
    seen = {view.name: len(view.ids) for view in views}
    views, bundle, left_out = without_outliers(views, bundle)
    corners = Corners.of(views)
    bundle, gain, weights = _with_coefficients_of(lens, bundle, corners)
    cov, std_px = covariance(bundle, corners, weights)
    check_after(bundle, cov)
    rows = tuple(tuple(row) for row in cov.tolist())
    return LensSolution(
        camera=replace(bundle.camera, name=name, std=CameraStd(), covariance=rows),
        views=views,
        corners=corners,
        bundle=bundle,
        off_px=residuals_px(bundle, corners),
        std_px=std_px,
        left_out=left_out,
        strays={view.name: lost for view in views if (lost := seen[view.name] - len(view.ids))},
        bic_gain=gain,
    )


def _begin(corners: Corners, lens: LensChoice, size_px: tuple[int, int]) -> Bundle:
    """The best of the first guesses, followed to their ends with four coefficients."""
    model = LensModel.FISHEYE if lens is LensChoice.FISHEYE else LensModel.BROWN
    ends = [
        adjust(reseated(adjust(guess, corners), corners), corners)
        for guess in first_guesses(corners, model, size_px, _FEWEST_COEFFICIENTS)[:_STARTS]
    ]
    if not ends:
        raise NoAnswerError(
            "no camera could see the boards as they were found",
            expected=f"views of one flat board through a {lens} lens",
            hint="is the board's COLSxROWS right, and does --lens suit the camera?",
        )
    return min(ends, key=lambda end: float(np.sum(residuals_px(end, corners) ** 2)))


def _with_coefficients_of(
    lens: LensChoice, four: Bundle, corners: Corners
) -> tuple[Bundle, float | None, FloatArray | None]:
    """The bundle with as many coefficients as the lens is to have, what the last ones are worth (BIC), and weights."""
    if lens is LensChoice.FISHEYE:
        return four, None, None
    five = adjust(_widened(four, _WITH_K3), corners)
    if lens is LensChoice.RATIONAL:
        weights = _weights_of_rational(five, corners)
        eight = adjust(_widened(five, _RATIONAL), corners, weights)
        return eight, _bic(five, corners) - _bic(eight, corners), weights
    gain = _bic(four, corners) - _bic(five, corners)
    return (five if gain > 0 else four), gain, None


def _weights_of_rational(five: Bundle, corners: Corners) -> FloatArray:
    """Weights that keep k4, k5, k6 near 0 where corners do not tell them from k1, k2, k3.

    Numerator and denominator of the radial factor may have a factor in common, which changes nothing, and without a
    weight the coefficients go to thousands and take the focal length with them.
    """
    off = residuals_px(five, corners)
    weights = np.zeros(4 + _RATIONAL)
    weights[-3:] = float(np.mean(off * off)) / _RATIONAL_STD**2
    return weights


def _widened(bundle: Bundle, coefficients: int) -> Bundle:
    return replace(bundle, camera=with_coefficients(bundle.camera, coefficients))


def _bic(bundle: Bundle, corners: Corners) -> float:
    """Schwarz' Bayesian information criterion, up to what models of the same views have in common."""
    off = residuals_px(bundle, corners)
    parameters = 4 + len(bundle.camera.distortion)
    return off.size * math.log(float(np.mean(off * off))) + parameters * math.log(off.size)
