"""Clicked points in a rendered flight that circles, climbs and zooms: they stay on the ground, or are lost."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest

from aerodft.conventions import SECOND_NS
from aerodft.dft import project
from aerodft.model import Camera, FloatArray, Image, Observation, PixelSource, Probe, ProbeKind, ProjectionModel
from aerodft.vision.plane_lock import TrackedProbes
from tests.truth import circling
from tests.truth.circling import CAMERA, Seen

pytestmark = pytest.mark.nightly

LIMIT = 0.005  # of the range
BANKS_ENU_M = np.array([[6.0, -9.0, 0.0], [-8.0, -20.0, 0.0]])
ASIDE_ENU_M = np.array([[22.0, -8.0, 0.0]])  # at the image's border at first


@dataclass(frozen=True)
class Look:
    """What was seen in one image, and what was there."""

    seen: Seen
    found: dict[str, Observation]
    points_enu_m: dict[str, FloatArray]


def image_of(seen: Seen) -> Image:
    stamp_ns = round(seen.time_s * SECOND_NS)
    index = round(seen.time_s * circling.FPS)
    return Image(index=index, stamp_ns=stamp_ns, arrival_ns=stamp_ns, pixels=lambda: seen.pixels)


def tracked(name: str, pixels: FloatArray) -> Probe:
    kind = ProbeKind.DISTANCE if len(pixels) > 1 else ProbeKind.POSITION
    return Probe(name=name, kind=kind, source=PixelSource.TRACKED, pixels=tuple(map(tuple, pixels.tolist())))


@pytest.fixture(scope="module")
def looks() -> list[Look]:
    said, done = {}, []
    observer, points = None, {}
    for seen in circling.flight():
        if observer is None:
            points = {"banks": BANKS_ENU_M, "aside": ASIDE_ENU_M}
            probes = tuple(tracked(name, seen.pixels_of(each)) for name, each in points.items())
            observer = TrackedProbes(CAMERA, probes, lambda image: said.get(image.index), None)
        if done:  # a pose is known after its image at first
            said[len(done)] = seen.said
        found = {each.name: each for each in observer.observe(image_of(seen))}
        said[len(done)] = seen.said
        done.append(Look(replace(seen, pixels=seen.pixels[:0]), found, points))
    return done


def off_share(look: Look, name: str) -> float:
    """How far the probe's ground points are off, over the range; NaN where it is lost."""
    pixels, truth = np.array(look.found[name].pixels), look.points_enu_m[name]
    if not len(pixels):
        return np.nan
    ground = project(look.seen.camera, look.seen.pose, pixels, 0.0, ProjectionModel.PINHOLE).points_enu_m
    off = np.linalg.norm(ground - truth, axis=-1) / np.linalg.norm(truth - look.seen.pose.position_enu_m, axis=-1)
    return float(np.max(off))


def is_inside(look: Look, name: str, margin_px: float = 0.0) -> bool:
    pixels = look.seen.pixels_of(look.points_enu_m[name])
    farthest = np.array([CAMERA.width_px, CAMERA.height_px]) - 0.5 - margin_px
    return bool(np.all((pixels >= margin_px - 0.5) & (pixels <= farthest)))


def test_points_stay_on_the_ground_for_a_minute_of_circling_climbing_and_zooming(
    looks: list[Look], capsys: pytest.CaptureFixture[str]
) -> None:
    shares = np.array([off_share(look, "banks") for look in looks])
    lost = int(np.count_nonzero(np.isnan(shares)))
    with capsys.disabled():
        print(
            f"\ntracked for {looks[-1].seen.time_s:.0f} s, {len(looks)} images: off by "
            f"{100 * np.nanmedian(shares):.3f} % of the range (median), {100 * np.nanmax(shares):.3f} % at most; "
            f"lost in {lost} images"
        )
    assert all(is_inside(look, "banks") for look in looks)
    assert np.nanmax(shares) < LIMIT
    assert lost <= 3
    assert not np.isnan(shares[-10:]).any(), "it survives to the end"


def test_a_point_that_leaves_the_image_is_lost_at_once_and_found_when_it_comes_back(looks: list[Look]) -> None:
    inside = np.array([is_inside(look, "aside", margin_px=-1.0) for look in looks])
    well_inside = np.array([is_inside(look, "aside", margin_px=1.0) for look in looks])
    found = np.array([bool(look.found["aside"].pixels) for look in looks])
    left = np.flatnonzero(inside[:-1] & ~inside[1:])
    came = np.flatnonzero(~well_inside[:-1] & well_inside[1:])
    assert len(left) >= 1
    assert len(came) >= 1
    assert not np.any(found & ~inside), "nothing is seen outside the image"
    assert np.mean(found[well_inside]) > 0.9
    assert np.nanmax([off_share(look, "aside") for look in looks]) < LIMIT


def test_the_std_of_what_is_tracked_covers_its_error(looks: list[Look]) -> None:
    off = []
    for look in looks[1:]:
        seen = look.found["banks"]
        if seen.pixels:
            error = np.array(seen.pixels) - look.seen.pixels_of(look.points_enu_m["banks"])
            off.append(float(np.max(np.abs(error))) / seen.std_px)
    assert np.quantile(off, 0.95) < 2.0


def followed(flight: Iterator[Seen], points_of: Callable[[Seen], FloatArray], camera: Camera = CAMERA) -> list[Look]:
    """Two points of the ground that are clicked in the first image; a pose is known with its image."""
    seen = next(flight)
    points = points_of(seen)
    probe = tracked("banks", seen.pixels_of(points))
    said = {image_of(seen).index: seen.said}
    observer = TrackedProbes(camera, (probe,), lambda image: said.get(image.index), None)
    observer.observe(image_of(seen))
    looks = []
    for seen in flight:
        said[image_of(seen).index] = seen.said
        (found,) = observer.observe(image_of(seen))
        looks.append(Look(replace(seen, pixels=seen.pixels[:0]), {"banks": found}, {"banks": points}))
    return looks


def of_stds(look: Look) -> float:
    """The larger coordinate of a probe's error, over its std; NaN where it is lost."""
    seen = look.found["banks"]
    if not seen.pixels:
        return np.nan
    error = np.array(seen.pixels) - look.seen.pixels_of(look.points_enu_m["banks"])
    return float(np.max(np.abs(error))) / seen.std_px


def on_the_ground(pixels: tuple[tuple[float, float], ...]) -> Callable[[Seen], FloatArray]:
    return lambda seen: project(seen.camera, seen.pose, np.array(pixels), 0.0, ProjectionModel.PINHOLE).points_enu_m


@pytest.mark.parametrize(("width_m", "start_s"), [(22.0, 46.0), (34.0, 46.0), (34.0, 50.0)])
def test_points_are_held_where_most_of_the_view_is_water(
    width_m: float, start_s: float, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = circling.back_over_the_river((start_s, 54.0), width_m=width_m)
    looks = followed(flight, on_the_ground(((60.0, 60.0), (580.0, 320.0))))
    here = [look for look in looks if is_inside(look, "banks")]
    off, stds = np.array([off_share(look, "banks") for look in here]), np.array([of_stds(look) for look in here])
    lost = int(np.count_nonzero(np.isnan(off)))
    with capsys.disabled():
        print(
            f"\nover a river of {width_m:.0f} m from {start_s:.0f} s on: lost in {lost} of {len(here)}, off by"
            f" {100 * np.nanmax(off):.3f} % of the range and {np.nanmax(stds):.2f} stds at most"
        )
    assert len(here) >= 8
    assert lost <= 0.1 * len(here)
    assert np.nanquantile(off, 0.95) < LIMIT, "but for the first half second, until it is told which of both is land"
    assert np.nanmax(stds) < 2.5


def test_a_lens_that_bends_is_followed_while_it_zooms() -> None:
    lens = replace(CAMERA, distortion=(-0.12, 0.03, 0.0005, -0.0004, 0.0))
    looks = followed(circling.flight(lens, (26.0, 36.0)), on_the_ground(((300.0, 200.0), (340.0, 160.0))), lens)
    here = [look for look in looks if is_inside(look, "banks")]
    assert len(here) >= 20
    assert np.ptp([look.seen.camera.fx_px for look in here]) > 100
    error = [np.array(look.found["banks"].pixels) - look.seen.pixels_of(look.points_enu_m["banks"]) for look in here]
    assert np.max(np.abs(error)) < 0.5  # 3.7 where the bent pixels are straightened as those of the lens not zoomed


def test_water_that_fills_the_view_is_no_ground() -> None:
    looks = followed(circling.over_nothing_but_water(6.0), on_the_ground(((250.0, 150.0), (400.0, 200.0))))
    stds = [of_stds(look) for look in looks]
    assert np.nanmax(stds) < 3, "what may be water has a std as large as its way"
    assert all(look.found["banks"].pixels == () for look in looks[5:])
    assert "water" in looks[-1].found["banks"].unseen


def test_without_telemetry_nothing_is_followed_for_long() -> None:
    flight = circling.over_nothing_but_water(6.0)
    seen = next(flight)
    observer = TrackedProbes(CAMERA, (tracked("banks", seen.pixels_of(BANKS_ENU_M)),), lambda _: None, None)
    observer.observe(image_of(seen))
    found = [bool(observer.observe(image_of(seen))[0].pixels) for seen in flight]
    assert not any(found[3:])


def test_another_place_is_not_taken_for_the_plane() -> None:
    flight = circling.flight()
    first = next(flight)
    observer = TrackedProbes(CAMERA, (tracked("banks", first.pixels_of(BANKS_ENU_M)),), lambda _: None, None)
    (given,) = observer.observe(image_of(first))
    assert given.pixels
    (still,) = observer.observe(image_of(first))
    np.testing.assert_allclose(still.pixels, given.pixels, atol=0.05)
    noise = np.random.default_rng(1).integers(0, 255, first.pixels.shape, dtype=np.uint8)
    for nothing in (noise, np.full_like(noise, 90)):
        (seen,) = observer.observe(image_of(replace(first, pixels=nothing)))
        assert seen.pixels == ()
    (again,) = observer.observe(image_of(first))
    np.testing.assert_allclose(again.pixels, given.pixels, atol=0.05)


def test_pixels_of_a_time_without_an_image_are_never_found() -> None:
    first = next(circling.flight())
    pixels = first.pixels_of(BANKS_ENU_M)
    late = replace(tracked("late", pixels), at_ns=2 * SECOND_NS)
    observer = TrackedProbes(CAMERA, (late,), lambda _: None, None)
    assert observer.observe(image_of(first)) == ()
    (seen,) = observer.observe(image_of(replace(first, time_s=5.0)))
    assert seen.pixels == ()
    in_time = TrackedProbes(CAMERA, (late,), lambda _: None, None)
    (begun,) = in_time.observe(image_of(replace(first, time_s=2.1)))
    assert begun.pixels == late.pixels
