"""A kind of probe that states nothing but scalar and gradient, in scenes over everything that a user may state."""

import math

import numpy as np
import pytest

from aerodft.dft import PROBE_KINDS, Z95, RayGeometry
from aerodft.model import ProbeKind, Status
from tests.dft.perimeter import KIND, PERIMETER, perimeter
from tests.nights import at_night

from .stated import SIZE, Stated

SCENES = 200
CORNERS = {3: 0.3, 4: 0.2, 8: 0.2, 40: 0.2, 200: 0.1}


def polygon(rng):
    """Corners around an ellipse, 15 to 300 px in radius: sides from a fraction of a pixel to half of the image."""
    corners = rng.choice(list(CORNERS), p=list(CORNERS.values()))
    turn = 2 * math.pi * np.arange(corners) / corners + rng.uniform(0, 6)
    radius_px = math.exp(rng.uniform(math.log(15), math.log(300))) * rng.uniform(0.7, 1.0, 2)
    return rng.uniform([320, 320], SIZE - 320) + radius_px * np.stack([np.cos(turn), np.sin(turn)], axis=-1)


def held(rng, measured):
    """Whether 95 % intervals of the measured kind hold the truth, in random scenes with answers."""
    found = []
    while len(found) < SCENES:
        scene, true_px = Stated.drawn(rng), polygon(rng)
        world = scene.world(rng, 1)
        directions, points_m = world.see(true_px[None])
        (answer,) = scene.answers([(measured, true_px + scene.std_px * rng.standard_normal(true_px.shape))])
        if answer.status is Status.OK and np.isfinite(points_m).all():
            (truth_m,) = PROBE_KINDS[measured].scalar(RayGeometry(world.position_m, directions, points_m))
            found.append(answer.ci95[0] <= truth_m <= answer.ci95[1])
    return np.array(found)


@pytest.mark.parametrize("measured", [PERIMETER, *at_night(ProbeKind.LENGTH)])
@pytest.mark.parametrize("seed", [0, *at_night(1, 2, 3, 4)])
def test_intervals_hold_the_truth_over_all_stated_errors(monkeypatch, measured, seed):
    """Of random corners, cameras, poses and errors, with noise of the pixels larger than the sides for some."""
    monkeypatch.setitem(PROBE_KINDS, PERIMETER, KIND)
    assert 0.92 <= held(np.random.default_rng(seed), measured).mean() <= 0.98


def test_noise_larger_than_the_sides_of_a_bend_is_taken_off(monkeypatch):
    """200 corners 0.6 to 2 standard deviations apart: an average wide enough for the noise would cut the bend short."""
    monkeypatch.setitem(PROBE_KINDS, PERIMETER, KIND)
    rng = np.random.default_rng(5)
    turn = 2 * math.pi * np.arange(200) / 200
    found = []
    while len(found) < 25:
        scene, radius_px = Stated.drawn(rng).exact(), rng.uniform(20, 60)
        true_px = SIZE / 2 + radius_px * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        directions, points_m = scene.world(rng, 1).see(true_px[None])
        noisy = Stated(**{**vars(scene), "std_px": 1.4})
        (answer,) = noisy.answers([(PERIMETER, true_px + 1.4 * rng.standard_normal(true_px.shape))])
        if answer.status is Status.OK and np.isfinite(points_m).all():
            geometry = RayGeometry(np.array([0.0, 0.0, scene.height_m]), directions, points_m)
            found.append((answer.value - perimeter(geometry)[0]) / answer.std)
    assert abs(np.mean(found)) < 0.6  # standard deviations; 2 to 6 with all of the noise left in
    assert np.mean(np.abs(found) <= Z95) >= 0.85
