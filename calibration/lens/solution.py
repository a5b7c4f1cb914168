"""From views of a board to a camera with its covariance: model choice, what is left out, and refusals.

Used are views that are sharp, different, and all over the image. Corners and whole views that disagree with all others
are left out, and the rest is solved again. Where views do not determine a lens, a sentence says what to add.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np

from aerodft.errors import NoAnswerError, counted
from aerodft.geometry import (
    LENS_MODELS,
    distorted_with_jacobian,
    pixels_from_rays,
    rays_by_intrinsics,
    rays_from_pixels,
    robust_std,
    skew,
)
from aerodft.model import Camera, FloatArray, LensModel
from calibration.lens.adjustment import (
    BoardView,
    Bundle,
    Corners,
    adjust,
    camera_guess,
    covariance,
    first_guesses,
    intrinsics_of,
    resect_boards,
    residuals_px,
    resolve_mirrored_boards,
    with_coefficients,
)
from calibration.lens.board import Board

MAX_VIEWS: Final = 40
_CELLS: Final = (9, 6)  # of the image, across and down
_SHARP_PX, _BLURRED = 3.0, 1.8  # always sharp enough; times the sharper quarter's
_NEAR_DUPLICATE = 0.01  # of the image's diagonal, between the same corners
_TILT_STEP_RAD = math.radians(15.0)
_WEIGHTS: Final = {"cell": 1.0, "tilt": 6.0, "size": 3.0}
_REGION: Final = (3, 2)  # cells of each of nine regions
_REGIONS: Final = (
    ("upper left", "top", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "bottom", "lower right"),
)
_COVERED = 0.34  # of a region's cells
_GOOD_TURN_DEG = 30.0
_GOOD_SIZE = 0.33  # of the image's width or height
_GOOD_VIEWS = 10
MIN_VIEWS: Final = 4
"""Three would do for a pinhole without noise; with four the residuals begin to say how good the corners are."""

_PARALLEL_DEG, _MIN_TURN_DEG = 3.0, 10.0  # between the boards that are turned most: by an assumed lens, and the found
_MAX_FOCAL_STD = 0.01  # share of the focal length
_MAX_CENTRE_STD = 0.02  # share of the image's longer side

_ADD = "hold the board tilted by 30 to 45 deg to the left, right, top and bottom, near and far, and in every corner"
_OUTLYING = 2.5  # times the median view's residual: more than blur or a bent board makes
_MAX_REJECTED = 0.25  # of all views
_STRAY = 6.0  # robust stds: of a billion corners 15 would be left out without reason
_MAX_STRAYS = 0.2  # of a view's corners: where more of them stray, it is the view that disagrees
_STARTS = 3  # best guesses that are followed to their end


def check_before(views: Sequence[BoardView], size_px: tuple[int, int]) -> None:
    """Refuse views that are too few, or all of boards that lie parallel to each other.

    Judged with an assumed lens: with boards that are parallel, an adjusted focal length could be anything.

    Raises:
        NoAnswerError: Says what to add.
    """
    if len(views) < MIN_VIEWS:
        got = f"{counted(len(views), 'usable view')} of the board"
        expected = f"{MIN_VIEWS}, better 15"
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
    if turn_deg < _MIN_TURN_DEG:
        raise _too_similar(f"boards that are turned by at most {turn_deg:.1f} deg from each other")
    _check_well_known(bundle, cov)


def _too_similar(got: str) -> NoAnswerError:
    what = "the views are too similar to tell focal length from distance"
    return NoAnswerError(what, got=got, expected=f"turned by {_MIN_TURN_DEG:.0f} deg, better 40", hint=_ADD)


def normals(views: Sequence[BoardView], size_px: tuple[int, int]) -> FloatArray:
    """``(v, 3)`` normals of the boards in camera axes, roughly: for a lens of about 55 degrees."""
    guess = resect_boards(camera_guess(LensModel.BROWN, size_px, float(max(size_px)), 0), Corners.from_views(views))
    return np.tile([0.0, 0.0, 1.0], (len(views), 1)) if guess is None else guess.rotations[:, :, 2]


def largest_turn_rad(facing: FloatArray) -> float:
    """Largest angle between two of the boards with normals ``(v, 3)``."""
    facing = facing * np.where(facing[:, 2:] < 0, -1.0, 1.0)  # a chessboard may be counted from either end
    return float(np.arccos(np.clip(np.min(facing @ facing.T), -1.0, 1.0)))


def _check_well_known(bundle: Bundle, cov: FloatArray) -> None:
    camera, std = bundle.camera, np.sqrt(np.diag(cov))
    focal = float(np.max(std[:2] / intrinsics_of(camera)[:2]))
    if not focal <= _MAX_FOCAL_STD:
        got = f"{camera.fx_px:.5g} px, known to {100 * focal:.2g} %" if math.isfinite(focal) else "no answer"
        expected = f"a std of at most {100 * _MAX_FOCAL_STD:g} %"
        raise NoAnswerError("the views hardly determine the focal length", got=got, expected=expected, hint=_ADD)
    longer = max(camera.width_px, camera.height_px)
    if not float(np.max(std[2:4])) <= _MAX_CENTRE_STD * longer:
        got = f"a std of {float(np.max(std[2:4])):.3g} px"
        expected = f"at most {_MAX_CENTRE_STD * longer:.2g} px"
        raise NoAnswerError("the views hardly determine the principal point", got=got, expected=expected, hint=_ADD)


def without_outliers(
    views: tuple[BoardView, ...], bundle: Bundle
) -> tuple[tuple[BoardView, ...], Bundle, tuple[tuple[BoardView, float], ...]]:
    """The views that agree, without single corners that stray, solved again.

    Args:
        views: All views.
        bundle: Adjusted to all of them.

    Returns:
        Views, their bundle, and the views that were left out with the rms (px) that each had then.
    """
    views, bundle = _without_strays(views, bundle)
    rejected: list[tuple[BoardView, float]] = []
    most = int(_MAX_REJECTED * len(views))
    while len(rejected) < most and len(views) > MIN_VIEWS:
        corners = Corners.from_views(views)
        rms = view_rms_px(residuals_px(bundle, corners), corners)
        worst = int(np.argmax(rms))
        if not rms[worst] > _OUTLYING * float(np.median(rms)):
            break
        rejected.append((views[worst], float(rms[worst])))
        views = (*views[:worst], *views[worst + 1 :])
        rest = np.arange(len(rms)) != worst
        bundle = _solved_again(views, Bundle(bundle.camera, bundle.rotations[rest], bundle.translations_m[rest]))
    if rejected:
        views, bundle = _without_strays(views, bundle)
    return views, bundle, tuple(rejected)


def view_rms_px(off_px: FloatArray, corners: Corners) -> FloatArray:
    """``(v,)`` root mean square of the lengths of residuals ``(n, 2)`` of each view."""
    counts = np.bincount(corners.view)
    return np.asarray(np.sqrt(corners.per_view(np.sum(off_px**2, axis=-1)) / counts))


def _without_strays(views: tuple[BoardView, ...], bundle: Bundle) -> tuple[tuple[BoardView, ...], Bundle]:
    corners = Corners.from_views(views)
    off = residuals_px(bundle, corners)
    std = robust_std(off)
    stray = np.linalg.norm(off, axis=-1) > _STRAY * std
    share = corners.per_view(stray.astype(np.float64)) / np.bincount(corners.view)
    stray &= (share <= _MAX_STRAYS)[corners.view]
    if not np.any(stray):
        return views, bundle
    kept = np.split(~stray, corners.starts[1:])
    views = tuple(
        replace(view, ids=view.ids[mask], pixels_px=view.pixels_px[mask], points_m=view.points_m[mask])
        for view, mask in zip(views, kept, strict=True)
    )
    return views, _solved_again(views, bundle)


def _solved_again(views: tuple[BoardView, ...], bundle: Bundle) -> Bundle:
    corners = Corners.from_views(views)
    return adjust(resolve_mirrored_boards(adjust(bundle, corners), corners), corners)


class LensChoice(StrEnum):
    """Lens models to choose from."""

    BROWN = "brown"
    RATIONAL = "rational"
    FISHEYE = "fisheye"

    @property
    def model(self) -> LensModel:
        """The lens model that is fitted."""
        return LensModel.BROWN if self is LensChoice.RATIONAL else LENS_MODELS[LensModel(self)].model


_MIN_COEFFICIENTS, _WITH_K3, _RATIONAL = 4, 5, 8
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
        rejected: Views that disagree with all others, with the rms (px) that each had when it was left out.
        strays: How many single corners were left out of the views, by name.
        bic_gain: How much the Bayesian information criterion falls with k3 (brown, where it was kept if that is above
            0), or with k4, k5, k6 (rational); None for others.
    """

    camera: Camera
    views: tuple[BoardView, ...]
    corners: Corners
    bundle: Bundle
    off_px: FloatArray
    std_px: float
    rejected: tuple[tuple[BoardView, float], ...]
    strays: dict[str, int]
    bic_gain: float | None

    @property
    def rms_px(self) -> float:
        """Root mean square of the residuals' lengths."""
        return math.sqrt(float(np.mean(np.sum(self.off_px**2, axis=-1))))

    @property
    def view_rms_px(self) -> FloatArray:
        """``(v,)`` root mean square of the residuals' lengths of each view."""
        return view_rms_px(self.off_px, self.corners)


def solve_lens(
    views: Sequence[BoardView], size_px: tuple[int, int], lens: LensChoice = LensChoice.BROWN, *, name: str = "camera"
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
    bundle = _begin(Corners.from_views(views), lens, size_px)
    seen = {view.name: len(view.ids) for view in views}
    views, bundle, rejected = without_outliers(views, bundle)
    corners = Corners.from_views(views)
    bundle, gain, weights = _with_coefficients_of(lens, bundle, corners)
    cov, std_px = covariance(bundle, corners, weights)
    check_after(bundle, cov)
    return LensSolution(
        camera=replace(bundle.camera, name=name).with_covariance(cov),
        views=views,
        corners=corners,
        bundle=bundle,
        off_px=residuals_px(bundle, corners),
        std_px=std_px,
        rejected=rejected,
        strays={view.name: lost for view in views if (lost := seen[view.name] - len(view.ids))},
        bic_gain=gain,
    )


def _begin(corners: Corners, lens: LensChoice, size_px: tuple[int, int]) -> Bundle:
    """The best of the first guesses, followed to their ends with four coefficients."""
    ends = [
        adjust(resolve_mirrored_boards(adjust(guess, corners), corners), corners)
        for guess in first_guesses(corners, lens.model, size_px, _MIN_COEFFICIENTS)[:_STARTS]
    ]
    if not ends:
        raise NoAnswerError(
            "no camera could see the boards as they were found",
            expected=f"views of one flat board through a {lens} lens",
            hint="is the board's COLSxROWS right, and does `lens` suit the camera?",
        )
    return min(ends, key=lambda end: float(np.sum(residuals_px(end, corners) ** 2)))


def _with_coefficients_of(
    lens: LensChoice, four: Bundle, corners: Corners
) -> tuple[Bundle, float | None, FloatArray | None]:
    """The bundle with as many coefficients as the lens is to have, what the last ones are worth (BIC), and weights."""
    if max(lens.model.coefficient_counts) == _MIN_COEFFICIENTS:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """Which views are used, and why the others are not.

    Attributes:
        used: In the order in which they were seen.
        blurred: Much less sharp than others.
        duplicates: Nearly the same as another one, which is sharper.
        surplus: Views of nothing that others do not show already.
    """

    used: tuple[BoardView, ...]
    blurred: tuple[BoardView, ...]
    duplicates: tuple[BoardView, ...]
    surplus: tuple[BoardView, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LensFit:
    """One lens calibration, from its images to its answer.

    Attributes:
        board: The board.
        lens: What the lens was to be described by.
        size_px: Width and height of all images.
        images: How many were looked at.
        choice: Which of those that show the board were used.
        solution: The lens.
    """

    board: Board
    lens: LensChoice
    size_px: tuple[int, int]
    images: int
    choice: Choice
    solution: LensSolution


def choose(views: Sequence[BoardView], size_px: tuple[int, int], most: int = MAX_VIEWS) -> Choice:
    """Choose at most so many views.

    Args:
        views: Those that show the board; at least one.
        size_px: Width and height of the images.
        most: How many may be used.
    """
    limit_px = max(_SHARP_PX, _BLURRED * float(np.quantile([view.edge_px for view in views], 0.25)))
    sharp = [view for view in views if view.edge_px <= limit_px]
    kept = _different(sorted(sharp, key=lambda view: view.edge_px), _NEAR_DUPLICATE * math.hypot(*size_px))
    used = _covering(kept, size_px, most)
    return Choice(
        used=_in_order(views, used),
        blurred=tuple(view for view in views if view.edge_px > limit_px),
        duplicates=_in_order(sharp, [view for view in sharp if view not in kept]),
        surplus=_in_order(kept, [view for view in kept if view not in used]),
    )


def _in_order(views: Sequence[BoardView], chosen: Sequence[BoardView]) -> tuple[BoardView, ...]:
    return tuple(view for view in views if view in chosen)


def _different(views: Sequence[BoardView], least_px: float) -> list[BoardView]:
    """The views without near-duplicates of earlier ones."""
    kept: list[BoardView] = []
    for view in views:
        if all(_moved_px(view, other) > least_px for other in kept):
            kept.append(view)
    return kept


def _moved_px(one: BoardView, other: BoardView) -> float:
    """Root mean square distance of the corners that both show; infinite where few are common."""
    _, mine, theirs = np.intersect1d(one.ids, other.ids, assume_unique=True, return_indices=True)
    if 2 * len(mine) < max(len(one.ids), len(other.ids)):
        return math.inf
    apart = one.pixels_px[mine] - other.pixels_px[theirs]
    return math.sqrt(float(np.mean(np.sum(apart * apart, axis=-1))))


def _covering(views: Sequence[BoardView], size_px: tuple[int, int], most: int) -> list[BoardView]:
    """Greedy: what few others show counts most, and of equals the sharper one (they come first) is taken."""
    if len(views) <= most:
        return list(views)
    features = _features(views, size_px)
    seen: Counter[tuple[str, int, int]] = Counter()
    rest = list(range(len(views)))
    used: list[BoardView] = []
    while len(used) < most:
        best = max(rest, key=lambda k: (sum(_WEIGHTS[f[0]] / (1 + seen[f]) for f in features[k]), -k))
        rest.remove(best)
        used.append(views[best])
        seen.update(features[best])
    return used


def _features(views: Sequence[BoardView], size_px: tuple[int, int]) -> list[set[tuple[str, int, int]]]:
    """Features of each view: cells of the image, a tilt in steps of 15 degrees, a size in octaves."""
    found = []
    for view, facing in zip(views, normals(views, size_px), strict=True):
        shown = {("cell", int(x), int(y)) for x, y in cells(view, size_px)}
        turned = np.rint(facing[:2] * np.where(facing[2] < 0, -1.0, 1.0) / _TILT_STEP_RAD).astype(int)
        shown.add(("tilt", int(turned[0]), int(turned[1])))
        size = np.ptp(view.pixels_px, axis=0) / size_px
        shown.add(("size", round(2 * math.log2(max(float(np.max(size)), 1e-3))), 0))
        found.append(shown)
    return found


def cells(view: BoardView, size_px: tuple[int, int]) -> np.ndarray:
    """``(m, 2)`` the cells of the image (across, down) that hold corners of a view."""
    share = (view.pixels_px + 0.5) / size_px
    return np.unique(np.clip((share * _CELLS).astype(int), 0, np.array(_CELLS) - 1), axis=0)


def covered_cells(views: Sequence[BoardView], size_px: tuple[int, int]) -> np.ndarray:
    """``(down, across)`` how many views have corners in each cell of the image."""
    counts = np.zeros(_CELLS[::-1], dtype=int)
    for view in views:
        across, down = cells(view, size_px).T
        counts[down, across] += 1
    return counts


def missing(solution: LensSolution) -> tuple[str, ...]:
    """Sentences on what would make the calibration better; none where nothing is missing."""
    views, size_px = solution.views, (solution.camera.width_px, solution.camera.height_px)
    sentences = []
    open_regions = _open_regions(covered_cells(views, size_px) > 0)
    if open_regions:
        where = " or ".join([", ".join(open_regions[:-1]), open_regions[-1]] if len(open_regions) > 1 else open_regions)
        sentences.append(f"hardly any corners in the {where} of the image: hold the board there")
    turn_deg = math.degrees(largest_turn_rad(solution.bundle.rotations[:, :, 2]))
    if turn_deg < _GOOD_TURN_DEG:
        sentences.append(
            f"the boards are turned by at most {turn_deg:.0f} deg from each other:"
            " tilt them by 30 to 45 deg to the left, right, top and bottom"
        )
    largest = max(float(np.max(np.ptp(view.pixels_px, axis=0) / size_px)) for view in views)
    if largest < _GOOD_SIZE:
        sentences.append(f"the board never fills more than {100 * largest:.0f} % of the image: come closer")
    if len(views) < _GOOD_VIEWS:
        sentences.append(f"{len(views)} views are few: 15 to 40 make the lens better known")
    return tuple(sentences)


def _open_regions(covered: np.ndarray) -> list[str]:
    across, down = _REGION
    found = []
    for row, names in enumerate(_REGIONS):
        for column, name in enumerate(names):
            region = covered[row * down : (row + 1) * down, column * across : (column + 1) * across]
            if np.mean(region) < _COVERED:
                found.append(name)
    return found


def distortion_px(camera: Camera, pixels_px: FloatArray) -> FloatArray:
    """Distances that the lens moves pixels ``(..., 2)`` from where coefficients of 0 would have them.

    That is a pinhole for a Brown lens, and for a fisheye one whose pixels are apart as angles are. NaN where the lens
    has no inverse.
    """
    ideal = with_coefficients(camera, 0)
    return np.asarray(pixels_px - pixels_from_rays(ideal, rays_from_pixels(camera, pixels_px)))


def ray_std_px(camera: Camera, cov: FloatArray, pixels_px: FloatArray) -> FloatArray:
    """Standard deviation of the rays of pixels ``(n, 2)`` in pixels: the longer half axis, ``(n,)``.

    A part of that is as if the whole camera were turned, which a pose that is found with this camera makes up for; it
    is left out.

    Args:
        camera: The camera, with its covariance.
        cov: Of its intrinsics.
        pixels_px: Pixels; those that the lens has no inverse for are NaN.
    """
    rays = rays_from_pixels(camera, pixels_px)
    sound = np.all(np.isfinite(rays), axis=-1)
    rays = rays[sound]
    by_ray = distorted_with_jacobian(camera, rays)[1] * np.array([[camera.fx_px], [camera.fy_px]])
    jac_intrinsics = by_ray @ rays_by_intrinsics(camera, pixels_px[sound])
    flat, turned = jac_intrinsics.reshape(-1, len(cov)), (by_ray @ skew(rays)).reshape(-1, 3)
    left = (flat - turned @ np.linalg.lstsq(turned, flat, rcond=None)[0]).reshape(-1, 2, len(cov))
    found = np.full(len(pixels_px), np.nan)
    found[sound] = np.sqrt(np.linalg.eigvalsh(left @ cov @ left.swapaxes(-1, -2))[:, -1].clip(0))
    return found
