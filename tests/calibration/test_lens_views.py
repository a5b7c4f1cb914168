"""Which views are used and which are not, and what is said when they do not determine a lens."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from aerodft.errors import NoAnswerError
from aerodft.geometry import pixels_from_rays, rays_from_pixels
from aerodft.model import Camera
from calibration.lens import (
    BoardView,
    LensChoice,
    choose,
    distortion_px,
    intrinsics_of,
    missing,
    parse_board,
    ray_std_px,
    solve_lens,
)
from calibration.lens.adjustment import with_intrinsics

from .board_pictures import TrueCamera, poses

SIZE = (960, 540)
BOARD = parse_board("charuco")
CAMERA = TrueCamera(*SIZE, (800.0, 795.0), (490.0, 262.0), (-0.25, 0.08, 0.001, -0.0008))


def views_of(found, rng=None, *, std_px=0.05, names="v"):
    rng = rng or np.random.default_rng(0)
    made = []
    for rotvec, move in found:
        pixels = CAMERA.project(BOARD.points_m(np.arange(54)), rotvec, move)
        ids = np.flatnonzero(np.all((pixels > 0) & (pixels < np.array(SIZE) - 1), axis=1))
        seen = pixels[ids] + rng.normal(0, std_px, (len(ids), 2))
        made.append(
            BoardView(name=f"{names}{len(made)}", ids=ids, pixels_px=seen, points_m=BOARD.points_m(ids), edge_px=2.0)
        )
    return made


def varied(count, seed=0, **way):
    return views_of(poses(CAMERA, BOARD, count, seed=seed, whole=False, **way), np.random.default_rng(seed))


def names(views):
    return [view.name for view in views]


def test_blurred_views_are_dropped():
    views = varied(10)
    views[3] = replace(views[3], edge_px=9.0)
    choice = choose(views, SIZE)
    assert names(choice.blurred) == ["v3"]
    assert len(choice.used) == 9


def test_of_near_duplicates_the_sharper_one_is_used():
    views = varied(6)
    again = replace(views[2], name="again", pixels_px=views[2].pixels_px + 1.5, edge_px=1.8)
    choice = choose([*views, again], SIZE)
    assert names(choice.duplicates) == ["v2"]
    assert "again" in names(choice.used)


def test_few_views_are_chosen_that_cover_what_all_cover():
    middle = [
        (rotvec * 0.3, np.array([-0.1, -0.06, 0.8]) + shift)
        for (rotvec, _), shift in zip(
            poses(CAMERA, BOARD, 60, seed=1), np.random.default_rng(1).uniform(-0.03, 0.03, (60, 3)), strict=True
        )
    ]
    views = [*views_of(middle, names="middle"), *varied(12, seed=2)]
    choice = choose(views, SIZE, most=15)
    assert len(choice.used) == 15
    assert sum(name.startswith("v") for name in names(choice.used)) >= 10
    assert len(choice.used) + len(choice.blurred) + len(choice.duplicates) + len(choice.surplus) == len(views)


def test_a_view_that_disagrees_is_left_out_by_name():
    views = varied(12)
    pixels = views[4].pixels_px + np.random.default_rng(9).normal(0, 1.5, views[4].pixels_px.shape)
    views[4] = replace(views[4], pixels_px=pixels)
    found = solve_lens(views, SIZE)
    assert names(view for view, _ in found.rejected) == ["v4"]
    assert found.rejected[0][1] > 1.0
    assert_allclose(found.std_px, 0.05, rtol=0.15)


def test_single_corners_that_stray_are_left_out():
    views = varied(12)
    pixels = views[4].pixels_px.copy()
    pixels[[3, 10]] += [1.2, -0.8]
    found = solve_lens([*views[:4], replace(views[4], pixels_px=pixels), *views[5:]], SIZE)
    assert found.strays == {"v4": 2}
    assert found.rejected == ()
    clean = solve_lens(views, SIZE)
    stds = np.sqrt(np.diag(clean.camera.covariance))
    assert np.all(np.abs(intrinsics_of(found.camera) - intrinsics_of(clean.camera)) < 0.5 * stds)


def test_too_few_views_are_refused():
    with pytest.raises(NoAnswerError, match="too few views to determine the lens: got 3 usable views"):
        solve_lens(varied(3), SIZE)


@pytest.mark.parametrize(
    ("lens", "tilt_rad"), [(LensChoice.BROWN, 0.0), (LensChoice.BROWN, 0.5), (LensChoice.RATIONAL, 0.3)]
)
def test_boards_that_are_parallel_to_each_other_are_refused(lens, tilt_rad):
    rng = np.random.default_rng(4)
    parallel = []
    while len(parallel) < 9:
        place = np.array([*rng.uniform([-0.2, -0.15], [0.02, 0.02]), rng.uniform(0.4, 0.9)])
        turn = Rotation.from_rotvec([tilt_rad, 0, 0]) * Rotation.from_rotvec([0, 0, rng.uniform(-0.5, 0.5)])
        parallel.append((turn.as_rotvec(), place))
    with pytest.raises(NoAnswerError, match="tilted by 30 to 45 deg"):
        solve_lens(views_of(parallel, rng), SIZE, lens)


def test_boards_that_are_hardly_turned_are_refused_or_known_badly():
    for seed in range(6):
        try:
            found = solve_lens(varied(8, seed=seed, turn_rad=0.12), SIZE)
        except NoAnswerError:
            continue
        assert abs(found.camera.fx_px - 800.0) < 4 * np.sqrt(found.camera.covariance[0][0])


def test_missing_corners_are_named_by_where_they_are():
    views = varied(40, seed=3)
    right = [
        replace(view, ids=view.ids[keep], pixels_px=view.pixels_px[keep], points_m=view.points_m[keep])
        for view in views
        if np.count_nonzero(keep := view.pixels_px[:, 0] > 330) > 15
    ]
    said = missing(solve_lens(right, SIZE))
    assert "hardly any corners in the upper left, left or lower left of the image: hold the board there" in said
    everywhere = " ".join(missing(solve_lens(views, SIZE)))
    assert "left" not in everywhere
    assert "tilt them" not in everywhere


def test_displacement_is_opencvs():
    camera = with_intrinsics(
        Camera(
            name="c", width_px=960, height_px=540, fx_px=1.0, fy_px=1.0, cx_px=0.0, cy_px=0.0, distortion=(0.0,) * 4
        ),
        CAMERA.parameters,
    )
    points = np.array([[-0.3, 0.2, 1.0], [0.1, 0.25, 1.0], [0.0, 0.0, 1.0]])
    seen = CAMERA.project(points, np.zeros(3), np.zeros(3))
    pinhole = points[:, :2] * CAMERA.focal + CAMERA.centre
    assert_allclose(distortion_px(camera, seen), seen - pinhole, atol=1e-7)


def test_how_well_pixels_are_known_is_what_other_calibrations_differ_by():
    """Spread of pixels over the covariance, each draw turned to fit the first best."""
    found = solve_lens(varied(12), SIZE).camera
    cov = np.array(found.covariance)
    grid = np.stack(np.meshgrid(np.linspace(20, 940, 12), np.linspace(20, 520, 8)), axis=-1).reshape(-1, 2)
    rng, off = np.random.default_rng(5), []
    for values in rng.multivariate_normal(intrinsics_of(found), cov, 200):
        other = np.array(rays_from_pixels(with_intrinsics(found, values), grid))

        def moved(rotvec, other=other):
            return (pixels_from_rays(found, Rotation.from_rotvec(rotvec).apply(other)) - grid).ravel()

        off.append(moved(least_squares(moved, np.zeros(3), method="lm").x).reshape(-1, 2))
    spread = np.array(off)
    covs = np.einsum("kni,knj->nij", spread, spread) / len(spread)
    assert_allclose(ray_std_px(found, cov, grid), np.sqrt(np.linalg.eigvalsh(covs)[:, -1]), rtol=0.25)
