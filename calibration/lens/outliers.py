"""Corners and whole views that disagree with all others are left out, and the rest is solved again."""

from dataclasses import replace

import numpy as np

from aerodft.geometry.robust import robust_std
from aerodft.model.arrays import FloatArray
from calibration.lens.adjustment import Bundle, adjust, residuals_px
from calibration.lens.determined import FEWEST_VIEWS
from calibration.lens.start import reseated
from calibration.lens.views import Corners, View

_OUTLYING = 2.5  # times the median view's residual: more than blur or a bent board makes
_MOST_LEFT_OUT = 0.25  # of all views
_STRAY = 6.0  # robust stds: of a billion corners 15 would be left out without reason
_MOST_STRAYS = 0.2  # of a view's corners: where more of them stray, it is the view that disagrees


def without_outliers(
    views: tuple[View, ...], bundle: Bundle
) -> tuple[tuple[View, ...], Bundle, tuple[tuple[View, float], ...]]:
    """The views that agree, without single corners that stray, solved again.

    Args:
        views: All views.
        bundle: Adjusted to all of them.

    Returns:
        Views, their bundle, and the views that were left out with the rms (px) that each had then.
    """
    views, bundle = _without_strays(views, bundle)
    left_out: list[tuple[View, float]] = []
    most = int(_MOST_LEFT_OUT * len(views))
    while len(left_out) < most and len(views) > FEWEST_VIEWS:
        corners = Corners.of(views)
        rms = view_rms_px(residuals_px(bundle, corners), corners)
        worst = int(np.argmax(rms))
        if not rms[worst] > _OUTLYING * float(np.median(rms)):
            break
        left_out.append((views[worst], float(rms[worst])))
        views = (*views[:worst], *views[worst + 1 :])
        rest = np.arange(len(rms)) != worst
        bundle = _solved_again(views, Bundle(bundle.camera, bundle.rotations[rest], bundle.translations_m[rest]))
    if left_out:
        views, bundle = _without_strays(views, bundle)
    return views, bundle, tuple(left_out)


def view_rms_px(off_px: FloatArray, corners: Corners) -> FloatArray:
    """``(v,)`` root mean square of the lengths of residuals ``(n, 2)`` of each view."""
    counts = np.bincount(corners.view)
    return np.asarray(np.sqrt(corners.per_view(np.sum(off_px**2, axis=-1)) / counts))


def _without_strays(views: tuple[View, ...], bundle: Bundle) -> tuple[tuple[View, ...], Bundle]:
    corners = Corners.of(views)
    off = residuals_px(bundle, corners)
    std = robust_std(off)
    stray = np.linalg.norm(off, axis=-1) > _STRAY * std
    share = corners.per_view(stray.astype(np.float64)) / np.bincount(corners.view)
    stray &= (share <= _MOST_STRAYS)[corners.view]
    if not np.any(stray):
        return views, bundle
    kept = np.split(~stray, corners.starts[1:])
    views = tuple(_only(view, mask) for view, mask in zip(views, kept, strict=True))
    return views, _solved_again(views, bundle)


def _only(view: View, kept: np.ndarray) -> View:
    return replace(view, ids=view.ids[kept], pixels_px=view.pixels_px[kept], points_m=view.points_m[kept])


def _solved_again(views: tuple[View, ...], bundle: Bundle) -> Bundle:
    corners = Corners.of(views)
    return adjust(reseated(adjust(bundle, corners), corners), corners)
