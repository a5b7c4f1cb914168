"""Stated standard deviations hold: errors of 3,700 random calibrations, and of some of which a fifth is wrong.

With ``AERODFT_FAULTS=full`` there are 5,600. The scenes are those of ``calibration_sets``: what people calibrate, from
landmarks, ranges, sizes, lines, the horizon, guesses with stds, and mixtures of these. Truth is OpenCV's projection and
closed forms.
"""

import math
import os
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

from .calibration_sets import DEG, POSE, TASKS, Task, drawn, landmarks, ranges, solved, together, with_outliers

pytestmark = pytest.mark.nightly

SCENES = {
    "a pose from landmarks": 400,
    "a lens from landmarks": 700,
    "an unknown camera": 700,
    "a pose from some of everything": 200,
    "water of unknown level": 1000,
    "a laser rangefinder": 300,
    "things of known size": 100,
    "lines and horizon": 100,
    "a building": 100,
    "points from the foot": 100,
}
ALL = {
    "a pose from landmarks": 800,
    "a lens from landmarks": 1000,
    "an unknown camera": 1000,
    "a pose from some of everything": 400,
    "water of unknown level": 1200,
    "a laser rangefinder": 400,
    "things of known size": 200,
    "lines and horizon": 200,
    "a building": 200,
    "points from the foot": 200,
}
IS_FULL = os.environ.get("AERODFT_FAULTS") == "full"
NARROWEST, WIDEST, FEWEST = 0.95, 1.05, 700
"""Of the standard deviation of errors in stated standard deviations, of each unknown over at least so many scenes. They
tell it to 0.027: stds that are 10 % too small are seen 96 times in 100, in 2,000 7 %."""
TIMES = 3 if IS_FULL else 1
SURE = 4.0
"""Standard deviations that all unknowns of one kind of scene together may be off by. Their joint covariance says what
each scene's errors, made independent, should be: 400 scenes of seven unknowns tell it to 0.013, and stds that are all
8 % too small, or correlations that are wrong, are seen 96 times in 100; 60 scenes of three tell it to 0.053."""

WITH_OUTLIERS = {
    "a pose from landmarks": (Task(POSE, landmarks(10, 20), tilt_deg=(3.0, 72.0)), 40),
    "a lens from landmarks": (TASKS["a lens from landmarks"], 20),
    "three unknowns from landmarks": (Task(("height", "tilt", "heading"), landmarks(10, 20)), 40),
    "a laser rangefinder": (Task(("height", "tilt"), ranges(8, 12)), 40),
    "landmarks, ranges and guesses": (
        Task(POSE, together(landmarks(8, 14), ranges(2, 3)), {"height": 0.05, "heading": 5 * DEG}), 30,
    ),
}  # fmt: skip
FAR, FEWEST_NEAR = 3.0, 0.99
MISTAKEN = 2
"""Outliers kept (chance may put one where it agrees), and others left out, at most, of about 100 and 400: a way to find
outliers that misses 7 % of them is seen 97 times in 100. With ``AERODFT_FAULTS=full``, of three times as many scenes,
three times as many."""


def scores(task, world, known):
    """Errors of the unknowns in their stated standard deviations, their mean square made independent, the solution."""
    solution, errors = solved(task, world, known)
    stds = np.sqrt(np.diag(solution.covariance))
    off = np.array([errors[name] for name in task.unknowns])
    joint = float(off @ np.linalg.solve(solution.covariance, off)) / len(off)
    return dict(zip(task.unknowns, off / stds, strict=True)), joint, solution


@pytest.mark.timeout(900)
def test_errors_are_as_large_as_stated():
    found, kinds = defaultdict(list), {}
    left_out = observations = 0
    for name, count in (ALL if IS_FULL else SCENES).items():
        rng, kinds[name] = np.random.default_rng([20, len(kinds)]), []
        for _ in range(count):
            z, joint, solution = scores(TASKS[name], *drawn(TASKS[name], rng))
            joint *= solution.sigma_scale**2  # stds are true here: the covariance is judged as they say it
            left_out += np.count_nonzero(~solution.kept)
            observations += len(solution.kept)
            kinds[name].append(joint)
            for unknown, score in z.items():
                found[unknown].append(score * solution.sigma_scale)
    print(f"\n{left_out} of {observations} observations left out\nunknown    scenes  std of z  mean of z  largest")
    for unknown, z in found.items():
        print(f"{unknown:10s} {len(z):6d} {np.std(z):9.3f} {np.mean(z):10.3f} {np.max(np.abs(z)):8.2f}")
    for name, joint in kinds.items():
        told = 1 / math.sqrt(2 * len(joint) * len(TASKS[name].unknowns))
        print(f"{name:32s} {len(joint):6d} scenes, std {math.sqrt(np.mean(joint)):.3f}, told to {told:.3f}")
        assert math.sqrt(np.mean(joint)) == pytest.approx(1.0, abs=SURE * told), name
    for unknown, z in found.items():
        assert len(z) >= FEWEST
        assert NARROWEST <= np.std(z) <= WIDEST, unknown
        assert abs(np.mean(z)) <= 4 / math.sqrt(len(z)), unknown


@pytest.mark.parametrize(("task", "count"), WITH_OUTLIERS.values(), ids=WITH_OUTLIERS)
def test_a_fifth_of_gross_outliers_does_no_harm(task, count):
    rng, found = np.random.default_rng(9), defaultdict(list)
    kept_wrong = lost_right = wrong_ones = 0
    for _ in range(TIMES * count):
        world, known = drawn(task, rng)
        disturbed = with_outliers(known, rng)
        z, _, solution = scores(task, world, disturbed)
        is_wrong = np.array([a is not b for a, b in zip(known.evidence, disturbed.evidence, strict=True)])
        wrong_ones += np.count_nonzero(is_wrong)
        kept_wrong += np.count_nonzero(is_wrong & solution.kept)
        lost_right += np.count_nonzero(~is_wrong & ~solution.kept)
        for unknown, score in z.items():
            found[unknown].append(abs(score) <= FAR)
    print(f"\n{TIMES * count} scenes, {wrong_ones} outliers: {kept_wrong} of them kept, {lost_right} others left out")
    print(", ".join(f"{unknown} {np.mean(near):.1%}" for unknown, near in found.items()) + f" within {FAR:g} std")
    assert kept_wrong <= TIMES * MISTAKEN
    assert lost_right <= TIMES * MISTAKEN
    for unknown, near in found.items():
        assert np.count_nonzero(~np.array(near)) <= allowed(len(near)), unknown


@pytest.mark.parametrize("count", [8, 12])
def test_pixels_worse_than_stated_are_no_outliers(count):
    """Of few landmarks some always agree by chance: the others are not wrong for that, all are five times as bad."""
    task, rng, found, left_out = Task(POSE, landmarks(count, count)), np.random.default_rng(31), [], 0
    for _ in range(TIMES * 45):
        world, known = drawn(task, rng, std_px=(2.5,), std_share=(0.0,))
        stated = replace(known, evidence=tuple(replace(each, std_px=0.5) for each in known.evidence))
        z, _, solution = scores(task, world, stated)
        left_out += np.count_nonzero(~solution.kept)
        found += [abs(score) <= 1.96 for score in z.values()]
    print(f"\n{count} landmarks: {np.mean(found):.1%} within 1.96 std, {left_out} left out")
    assert 0.92 <= np.mean(found) <= 0.97
    assert left_out <= TIMES * 2


def allowed(count):
    """Of so few scenes, at most what chance allows (one time in 1,000) where 99 % are near."""
    misses = np.arange(count + 1)
    logs = [math.lgamma(count + 1) - math.lgamma(m + 1) - math.lgamma(count - m + 1) for m in misses]
    chance = np.exp(logs + misses * math.log(1 - FEWEST_NEAR) + (count - misses) * math.log(FEWEST_NEAR))
    return int(np.searchsorted(np.cumsum(chance), 0.999))
