"""Scenes that cannot answer are refused, whatever is asked: exit 4, no file, and the right unknown named."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from aerodft.model import Camera, EvidenceSet, Landmark, SlantRange
from calibration.pose import calibrate

from .calibration_files import aerodft, tables, write_camera, write_evidence
from .calibration_scenes import World
from .scenes import opencv_rays

CAMERA = Camera(
    name="c", width_px=1920, height_px=1080, fx_px=1500.0, fy_px=1500.0, cx_px=959.5, cy_px=539.5,
    distortion=(0.0, 0.0, 0.0, 0.0),
)  # fmt: skip
POSE = "position,height,tilt,roll,heading"


def world(tilt_deg=55.0, roll_deg=2.0, heading_deg=40.0):
    """20 m above the ground, seen with 1 px."""
    rng = np.random.default_rng(11)
    angles = map(math.radians, (tilt_deg, roll_deg, heading_deg))
    return World(CAMERA, *angles, np.array([3.0, -5.0, 20.0]), 0.0, rng, std_px=1.0)


def landmarks(scene, points):
    pixels = scene.pixels(points)
    return [
        Landmark(name=f"p{index + 1}", pixel=pixel, position_m=tuple(point.tolist()))
        for index, (pixel, point) in enumerate(zip(pixels, points, strict=True))
    ]


def seen_at(scene, pixels, above_m=0.0):
    """Ground points of these pixels."""
    rays = opencv_rays(scene.camera, pixels) @ scene.axes.T
    return scene.position_m + rays * ((above_m - scene.position_m[2]) / rays[:, 2])[:, None]


def ranges(scene, pixels):
    points = seen_at(scene, pixels)
    return [
        SlantRange(name=f"r{index + 1}", pixel=pixel, range_m=math.dist(point, scene.position_m))
        for index, (pixel, point) in enumerate(zip(scene.pixels(points), points, strict=True))
    ]


def spread(scene, count=8, most_above=0.2):
    return [scene.landmark(f"p{index + 1}", most_above=most_above) for index in range(count)]


def collinear(scene):
    start, end = seen_at(scene, [[300.0, 900.0], [1500.0, 300.0]])
    return landmarks(scene, start + np.linspace(0, 1, 6)[:, None] * (end - start))


def in_one_pixel(scene):
    points = seen_at(scene, [[900.0, 600.0], [900.4, 600.1], [900.1, 600.5], [900.5, 600.4], [900.2, 600.2]])
    return landmarks(replace(scene, std_px=0.0), points)


def in_the_middle(scene):
    pixels = scene.rng.uniform([940, 520], [980, 560], (12, 2))
    return landmarks(scene, seen_at(scene, pixels))


MIDDLE = np.array([[959.5, v] for v in (200.0, 400.0, 600.0, 800.0, 1000.0)])
WIDE = np.array([[200.0, 300.0], [1700.0, 350.0], [400.0, 900.0], [1500.0, 950.0], [950.0, 600.0], [600.0, 500.0]])
ONE_ROW = np.column_stack([WIDE[:, 0], np.full(len(WIDE), 539.5)])


@dataclass(frozen=True)
class Planted:
    """What cannot be told.

    Attributes:
        unknowns: As asked.
        evidence: What is known.
        named: Unknowns that must be named; empty where nearly all of them could be.
        scene: Where.
    """

    unknowns: str
    evidence: Callable[[World], list]
    named: set[str]
    scene: World


TILTED, LEVEL, DOWN = world(), world(roll_deg=0.0), world(0.0, 0.0)
EXACT = replace(LEVEL, std_px=0.0)
PLANTED = {
    "one landmark": Planted(POSE, lambda s: spread(s, 1), set(), TILTED),
    "two landmarks": Planted(POSE, lambda s: spread(s, 2), set(), TILTED),
    "landmarks in a line": Planted(POSE, collinear, set(), TILTED),
    "landmarks in one pixel": Planted(POSE, in_one_pixel, set(), TILTED),
    "flat ground straight down, focal length": Planted(
        f"{POSE},focal", lambda s: landmarks(s, seen_at(s, WIDE)), {"height", "focal"}, DOWN
    ),
    "a single range": Planted("height,tilt", lambda s: ranges(s, WIDE[:1]), {"height"}, LEVEL),
    "ranges along the middle row": Planted("height,tilt", lambda s: ranges(s, ONE_ROW), {"height"}, EXACT),
    "two ranges, focal length": Planted("height,tilt,focal", lambda s: ranges(s, WIDE[:2]), {"focal"}, LEVEL),
    "ranges in the middle column, roll": Planted("height,tilt,roll", lambda s: ranges(s, MIDDLE), {"roll"}, EXACT),
    "no place in the world, heading": Planted("height,tilt,heading", lambda s: ranges(s, WIDE), {"heading"}, LEVEL),
    "no place in the world, position": Planted("height,tilt,position", lambda s: ranges(s, WIDE), {"east"}, LEVEL),
    "ranges alone, height and elevation": Planted(
        "height,tilt,elevation", lambda s: ranges(s, WIDE), {"height", "elevation"}, LEVEL
    ),
    "the horizon alone, height": Planted(
        "height,tilt,roll", lambda s: [s.horizon("horizon", 5)], {"height"}, world(80.0)
    ),
    "verticals alone, height": Planted(
        "height,tilt,roll", lambda s: [s.vertical(f"v{index}") for index in range(5)], {"height"}, TILTED
    ),
    "right angles alone, height": Planted(
        "height,tilt,roll", lambda s: [s.lines(f"a{index}", at_right_angle=True) for index in range(5)], {"height"},
        TILTED,
    ),
    "straight down without a place, heading": Planted(
        "height,tilt,roll,heading", lambda s: ranges(s, WIDE), {"heading"}, DOWN
    ),
    "landmarks in the middle, distortion": Planted(f"{POSE},k1,k2", in_the_middle, {"k2"}, TILTED),
}  # fmt: skip


@pytest.mark.parametrize("planted", PLANTED.values(), ids=PLANTED)
def test_what_cannot_be_told_is_refused_by_name(planted, tmp_path):
    answer = ask(planted, tmp_path)
    print(answer.words)
    weakest = set(answer.document["observability"]["weakest"])
    assert answer.code == 4, answer.words
    assert not (tmp_path / "out.toml").exists()
    assert weakest, answer.words
    assert weakest >= planted.named, answer.words
    assert all(name in answer.words for name in weakest)


def ask(planted, folder, lens=CAMERA):
    observations = write_evidence(
        folder / "known.toml", **tables(planted.evidence(replace(planted.scene, rng=np.random.default_rng(11))))
    )
    camera = write_camera(folder / "camera.toml", lens)
    return aerodft(
        "calibrate", observations, "--camera", camera, "--unknowns", planted.unknowns, "-o", folder / "out.toml"
    )


def test_a_camera_that_looks_straight_down_is_no_such_scene(tmp_path):
    """Roll and heading turn about one axis there, and are anything; the attitude itself is known well."""
    planted = Planted(POSE, lambda s: spread(s, 12), set(), world(0.3, 0.0))
    answer = ask(planted, tmp_path)
    assert answer.code == 0, answer.words
    assert (tmp_path / "out.toml").exists()


def test_the_same_landmark_twice_is_refused_at_once(tmp_path):
    planted = Planted(POSE, lambda s: spread(s, 5) * 2, set(), TILTED)
    answer = ask(planted, tmp_path)
    assert answer.code == 3, answer.words
    assert not (tmp_path / "out.toml").exists()


@pytest.mark.parametrize("count", [3, 4])
def test_no_landmarks_are_taken_for_their_mirror_image(count):
    """Three landmarks fit up to four cameras, four on a plane sometimes two: the right one, or none."""
    names = ("position", "height", "tilt", "roll", "heading")
    answered = refused = 0
    for seed in range(60):
        scene = World.random(np.random.default_rng(seed), std_px=0.5)
        known = EvidenceSet(evidence=tuple(spread(scene, count, most_above=0.0)))
        result = calibrate(known, scene.camera, names)
        if result.solution.alternative is not None or not result.weakest.is_determined:
            refused += 1
            continue
        answered += 1
        stds = np.sqrt(np.diag(result.named_covariance))
        for name, std in zip(result.problem.unknowns.names, stds, strict=True):
            off = result.solution.state.value(name) - scene.truth[name]
            off = (off + math.pi) % (2 * math.pi) - math.pi if name in ("roll", "heading") else off
            assert abs(off) <= 6 * std, (seed, name)
    print(f"\n{count} landmarks: {answered} answered, {refused} refused")
    assert answered > 0


def test_a_second_camera_that_fits_is_shown(tmp_path):
    scene = World.random(np.random.default_rng(1), std_px=0.5)
    answer = ask(Planted(POSE, lambda s: spread(s, 3, 0.0), set(), scene), tmp_path, scene.camera)
    assert answer.code == 4, answer.words
    assert "fit another camera as well" in answer.words
    assert answer.document["observability"]["rival"].keys() == answer.document["parameters"].keys()
    assert not (tmp_path / "out.toml").exists()
