"""Persons who walk in a rendered yard: where they stand, without their shadows; and who is who behind a wall."""

import math
from collections import defaultdict

import numpy as np
import pytest

from aerodft.conventions import SECOND_NS
from aerodft.dft import Setup, locate_outline
from aerodft.model import Image, Observation, PoseSample, ProbeKind, Status
from aerodft.service import OBJECTS, ObjectSettings
from aerodft.vision.objects import MovingObjects, ObjectTracks
from tests.truth import walkers as yard

pytestmark = pytest.mark.nightly

PIXEL = 1.0


def footing_errors_px(*, shadows: bool, sun_azimuth_deg: float, seed: int) -> list[float]:
    observer = MovingObjects(yard.CAMERA, ObjectSettings(shadows=shadows))
    errors = []
    for time_s, pixels in yard.images(yard.APART, 45, sun_azimuth_deg=sun_azimuth_deg, seed=seed):
        outlines = observer.outlines(pixels)
        if time_s * yard.FPS < yard.EMPTY + 1:
            continue
        for walker, foot in zip(yard.APART, yard.feet_px(yard.APART, time_s), strict=True):
            chest = yard.pixels_of(walker.foot_enu_m(time_s) + [0.0, 0.0, 1.1])
            inside = [o for o in outlines if np.all((o.min(axis=0) < chest) & (chest < o.max(axis=0)))]
            assert inside, f"a walker is not seen at {time_s} s"
            errors.append(float(np.linalg.norm(locate_outline(yard.CAMERA, yard.POSE, inside[0]).foot_px - foot)))
    return errors


@pytest.mark.parametrize(("sun_azimuth_deg", "seed"), [(20.0, 1), (140.0, 2), (275.0, 3)])
def test_a_foot_is_found_to_3_px_beside_its_shadow(
    sun_azimuth_deg: float, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    without, with_shadow = (
        footing_errors_px(shadows=shadows, sun_azimuth_deg=sun_azimuth_deg, seed=seed) for shadows in (True, False)
    )
    with capsys.disabled():
        print(
            f"\nfooting, sun at {sun_azimuth_deg:.0f} deg: shadow removed median {np.median(without):.2f} px, "
            f"90 % {np.quantile(without, 0.9):.2f} px; left in median {np.median(with_shadow):.1f} px, "
            f"90 % {np.quantile(with_shadow, 0.9):.1f} px"
        )
    assert np.median(without) <= 3 * PIXEL
    assert np.quantile(without, 0.9) <= 6 * PIXEL
    if sun_azimuth_deg < 90 or sun_azimuth_deg > 270:  # the shadow falls towards the camera, below the feet
        assert np.median(with_shadow) > 10 * PIXEL


def test_who_is_there_from_the_first_image_on_leaves_nobody_behind_where_he_was() -> None:
    observer, strangers = MovingObjects(yard.CAMERA, ObjectSettings()), []
    for time_s, pixels in yard.images(yard.APART, 30, sun_azimuth_deg=30.0, seed=1, empty_images=0):
        outlines = observer.outlines(pixels)
        chests = [yard.pixels_of(walker.foot_enu_m(time_s) + [0.0, 0.0, 1.1]) for walker in yard.APART]
        mine = [o for o in outlines if any(np.all((o.min(axis=0) < c) & (c < o.max(axis=0))) for c in chests)]
        if time_s > 1.0:
            assert len(mine) == len(yard.APART)
            strangers.append(len(outlines) - len(mine))
    assert np.mean(strangers) < 0.1  # 2 where what was learned first stays


@pytest.fixture(scope="module")
def followed() -> list[tuple[float, list]]:
    """Time and measurements of every image of three walkers, two of whom pass behind the wall."""
    settings = ObjectSettings(distances_within_m=100.0)
    observer, tracks = MovingObjects(yard.CAMERA, settings), ObjectTracks(settings)
    setup = Setup(camera=yard.CAMERA)
    found = []
    for time_s, pixels in yard.images(yard.BEHIND, 135, sun_azimuth_deg=30.0, seed=1, walls=(yard.WALL,)):
        stamp_ns = round(time_s * SECOND_NS)
        image = Image(index=round(time_s * yard.FPS), stamp_ns=stamp_ns, arrival_ns=stamp_ns, pixels=lambda p=pixels: p)
        sample = PoseSample(stamp_ns=stamp_ns, status=Status.OK, pose=yard.POSE, std=yard.STD)
        answers = tracks.follow(setup, sample, observer.observe(image), image.index)
        found.append((time_s, [each for answer in answers or () for each in answer]))
    return found


def test_walkers_keep_their_identity_behind_a_wall(followed) -> None:
    nearest = defaultdict(set)
    statuses = defaultdict(set)
    for time_s, measurements in followed:
        truth = np.array([walker.foot_enu_m(time_s)[:2] for walker in yard.BEHIND])
        for each in measurements:
            if each.kind == ProbeKind.TRACK:
                off = np.linalg.norm(truth - np.array(each.enu_m[0][:2]), axis=-1)
                nearest[each.name].add(int(np.argmin(off)))
                statuses[each.name].add(each.status)
                assert (each.value is None) == (each.status is not Status.OK)
    assert sorted(nearest) == ["object-1", "object-2", "object-3"]
    assert sorted(map(tuple, nearest.values())) == [(0,), (1,), (2,)], "each name is one walker, all the time"
    assert sum(Status.OCCLUDED in seen for seen in statuses.values()) >= 2


def test_the_ellipse_covers_where_they_are_also_while_they_are_hidden(followed) -> None:
    covered = {Status.OK: [], Status.OCCLUDED: []}
    grown = []
    for time_s, measurements in followed:
        truth = np.array([walker.foot_enu_m(time_s)[:2] for walker in yard.BEHIND])
        for each in measurements:
            if each.kind != ProbeKind.TRACK:
                continue
            off = np.array(each.enu_m[0][:2]) - truth
            off = off[np.argmin(np.linalg.norm(off, axis=-1))]
            cov = np.array(each.cov_enu_m2)[:2, :2]
            covered[each.status].append(off @ np.linalg.solve(cov, off) < 5.99)
            grown.append((each.status is Status.OCCLUDED, math.sqrt(np.trace(cov))))
    print({str(status): f"{np.mean(inside):.3f} of {len(inside)}" for status, inside in covered.items()})
    shares = {status: (np.mean(inside), len(inside)) for status, inside in covered.items()}
    assert shares[Status.OCCLUDED][1] >= 20
    assert min(share for share, _ in shares.values()) >= 0.9, shares
    largest = [max(std for hidden, std in grown if hidden is which) for which in (False, True)]
    assert largest[1] > 2 * largest[0], "what is not seen becomes uncertain"


def test_speeds_and_distances_are_true_within_their_intervals(followed) -> None:
    speeds, distances = [], []
    for time_s, measurements in followed[40:]:
        truth = np.array([walker.foot_enu_m(time_s)[:2] for walker in yard.BEHIND])
        owner = {
            each.name: int(np.argmin(np.linalg.norm(truth - np.array(each.enu_m[0][:2]), axis=-1)))
            for each in measurements
            if each.kind == ProbeKind.TRACK
        }
        for each in measurements:
            if each.status is not Status.OK:
                continue
            low, high = each.ci95
            if each.kind == ProbeKind.TRACK:
                assert each.unit == "m/s"
                speeds.append(low <= yard.BEHIND[owner[each.name]].speed_mps <= high)
            else:
                first, second = (owner[f"object-{number}"] for number in each.name.split("-")[1::2])
                distances.append(low <= np.linalg.norm(truth[first] - truth[second]) <= high)
    assert len(speeds) > 150
    assert len(distances) > 60
    assert np.mean(speeds) >= 0.9  # the third turns round three times
    assert np.mean(distances) >= 0.93


def outline(foot_enu_m: np.ndarray, from_m: float, stamp_ns: int) -> Observation:
    """Somebody of 1.8 m by 0.5 m, of whom only what is above a height is seen."""
    corners = [
        foot_enu_m + [east, 0.0, up] for east, up in ((-0.25, from_m), (0.25, from_m), (0.25, 1.8), (-0.25, 1.8))
    ]
    contour = tuple((u, v) for u, v in yard.pixels_of(np.array(corners)).tolist())
    return Observation(name=OBJECTS, stamp_ns=stamp_ns, arrival_ns=stamp_ns, pixels=(), contour=contour)


def test_who_is_seen_from_the_hips_up_is_not_forgotten() -> None:
    """For 9 s behind a long wall; nobody is given up while something of him is seen."""
    settings = ObjectSettings()
    tracks, setup = ObjectTracks(settings), Setup(camera=yard.CAMERA)
    for k in range(140):
        stamp_ns, hidden = k * SECOND_NS // 10, 20 <= k < 110
        foot = np.array([4.0 - 0.06 * k, 16.0, 0.0])
        sample = PoseSample(stamp_ns=stamp_ns, status=Status.OK, pose=yard.POSE, std=yard.STD)
        seen = (outline(foot, 1.1 if hidden else 0.0, stamp_ns),)
        made = [each for answer in tracks.follow(setup, sample, seen, k) or () for each in answer]
        if k < settings.confirm_looks:
            continue
        (track,) = made
        assert track.name == "object-1"
        assert track.status is (Status.OCCLUDED if hidden else Status.OK)
        off = np.array(track.enu_m[0][:2]) - foot[:2]
        assert off @ np.linalg.solve(np.array(track.cov_enu_m2)[:2, :2], off) < 9.2


def test_a_speck_is_nobody_s_head() -> None:
    """One image shows 0.1 m of something at the wall's edge, 2.5 m from where somebody is behind it."""
    tracks, setup = ObjectTracks(ObjectSettings()), Setup(camera=yard.CAMERA)
    for k in range(60):
        stamp_ns = k * SECOND_NS // 10
        foot = np.array([4.0 - 0.1 * k, 16.0, 0.0])
        sample = PoseSample(stamp_ns=stamp_ns, status=Status.OK, pose=yard.POSE, std=yard.STD)
        seen = () if k >= 25 else (outline(foot, 0.0, stamp_ns),)
        if k == 50:
            seen = (outline(np.array([foot[0] - 2.5, 16.0, 0.0]), 1.72, stamp_ns),)
        made = [each for answer in tracks.follow(setup, sample, seen, k) or () for each in answer]
    (track,) = made
    assert track.status is Status.OCCLUDED
    assert np.linalg.norm(np.array(track.enu_m[0][:2]) - foot[:2]) < 0.5
