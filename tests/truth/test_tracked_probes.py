"""Clicked points in a rendered flight that circles, climbs and zooms: they stay on the ground, or are lost."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from aerodft.conventions import SECOND_NS
from aerodft.dft.projection import project
from aerodft.model.arrays import FloatArray
from aerodft.model.image import Image
from aerodft.model.measurement import ProjectionModel
from aerodft.model.observation import Observation
from aerodft.model.probe import PixelSource, Probe, ProbeKind
from aerodft.vision.tracked_probes import TrackedProbes
from tests.truth import circling
from tests.truth.circling import CAMERA, Seen

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
