"""Glittering water before a fixed camera: it is no crowd, and who walks beside it is seen."""

import cv2
import numpy as np

from aerodft.model import Camera, Image, ImageArray, Observation
from aerodft.service import ObjectSettings
from aerodft.vision.objects import MovingObjects
from aerodft.vision.objects.moving import observations_of

WIDTH, HEIGHT = 480, 270
CAMERA = Camera.from_fov(name="c", width_px=WIDTH, height_px=HEIGHT, hfov_rad=1.0, vfov_rad=0.6)
SPARK = 8


def place(k: int, draws: np.random.Generator, *, water_from: int, walks: bool) -> ImageArray:
    """Water, ever another light, over all columns from one on; somebody dark in front of the rest."""
    image = np.full((HEIGHT, WIDTH, 3), 110, dtype=np.uint8)
    light = draws.uniform(60, 240, (HEIGHT // SPARK + 1, WIDTH // SPARK)).astype(np.float32)
    glitter = cv2.resize(light, None, fx=SPARK, fy=SPARK, interpolation=cv2.INTER_LINEAR)[:HEIGHT, water_from:]
    image[:, water_from:] = np.clip(glitter, 0, 255).astype(np.uint8)[..., None]
    if walks:
        left = 20 + 4 * k
        image[150:210, left : left + 18] = 30
    noise = draws.normal(0, 2, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def looks(*, water_from: int, count: int = 75) -> tuple[MovingObjects, list[tuple[Observation, ...]]]:
    observer, draws, seen = MovingObjects(CAMERA, ObjectSettings(shadows=False)), np.random.default_rng(1), []
    for k in range(count):
        pixels = place(k - 45, draws, water_from=water_from, walks=k >= 45)
        image = Image(index=k, stamp_ns=k * 100_000_000, arrival_ns=0, pixels=lambda p=pixels: p)
        seen.append(observer.observe(image))
    return observer, seen


def test_water_all_over_is_known_for_restless_after_some_seconds():
    _, seen = looks(water_from=0)
    counts = [sum(bool(each.contour) for each in image) for image in seen]
    assert max(counts[:20]) > 5
    assert np.mean(counts[40:45]) < 4


def test_who_walks_beside_water_is_seen_once_the_water_is_known_for_restless():
    _, seen = looks(water_from=280)
    for k in range(48, 75):
        outlines = [np.array(each.contour) for each in seen[k] if each.contour]
        left = 20 + 4 * (k - 45)
        assert 1 <= len(outlines) <= 4, k
        apart = [np.max(np.abs(outline.min(axis=0) - [left - 0.5, 149.5])) for outline in outlines]
        assert min(apart) < 2.5, k


def test_a_crowd_that_cannot_be_is_nothing_and_that_is_said():
    square = np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]])
    image = Image(index=0, stamp_ns=5, arrival_ns=5)
    some = observations_of([square + 12 * k for k in range(30)], image, 2.0)
    assert len(some) == 30
    (nothing,) = observations_of([square + 12 * k for k in range(31)], image, 2.0)
    assert nothing.is_empty
    assert "ignore says where" in nothing.unseen
