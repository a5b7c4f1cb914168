"""Intervals over everything that a user may state, against Monte-Carlo of the full nonlinear model.

Held are 92 to 98 of 100 draws in each cell, never less than 90, by intervals that hold their own value; what is refused
stays refused when something is known worse.
"""

import math
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

from aerodft.model import ProbeKind, Status

from .stated import DRAWS, SIZE, Stated, content, random_probes

TILTS_DEG = (0, 10, 60, 90)
SAMPLE, FULL = 12, pytest.param(800, marks=[pytest.mark.nightly, pytest.mark.timeout(1800)])


def cell_of(stated, probe):
    kind, pixels = probe
    count = f" of {len(pixels)}" if kind == ProbeKind.BEARING else ""
    return f"{kind}{count}, tilt to {TILTS_DEG[np.searchsorted(TILTS_DEG, math.degrees(stated.tilt_rad) + 1e-9)]} deg"


@pytest.mark.parametrize("scenes", [SAMPLE, FULL])
def test_intervals_hold_what_the_nonlinear_model_draws(scenes, capsys):
    rng, cells = np.random.default_rng(scenes), defaultdict(list)
    for _ in range(scenes):
        stated, probes = Stated.drawn(rng), random_probes(rng)
        for probe, answer in zip(probes, stated.answers(probes), strict=True):
            if answer.status is not Status.OK:
                continue
            kind, pixels = probe
            noisy = pixels + stated.std_px * rng.standard_normal((DRAWS, *pixels.shape))
            held = content(answer, stated.world(rng, DRAWS).values(kind, noisy))
            cells[cell_of(stated, probe)].append(held)
            assert held >= 0.9, (stated, probe, answer.value, answer.ci95)
            if answer.ci95 is not None:
                assert answer.ci95[0] <= answer.value <= answer.ci95[1], (stated, probe, answer.ci95)
    with capsys.disabled():
        print(f"\n{scenes} scenes: share of draws that intervals hold, least, mean, most, answers")
        for cell, held in sorted(cells.items()):
            print(f"  {cell:28s} {min(held):6.1%} {np.mean(held):6.1%} {max(held):6.1%} {len(held):5d}")
    assert len(cells) >= 25
    for cell, held in cells.items():
        assert 0.92 <= np.mean(held) <= 0.98, cell


def worse_than(stated):
    """The same, with one std each that is three times as large and more."""
    std, lens = stated.std, stated.camera.std
    for name in ("height_agl_m", "horizontal_m", "tilt_rad", "pan_rad", "roll_rad", "heading_rad"):
        yield name, replace(stated, std=replace(std, **{name: 3 * getattr(std, name) + 0.3}))
    yield "pixels", replace(stated, std_px=3 * stated.std_px + 1)
    yield "elevation", replace(stated, elevation_std_m=3 * stated.elevation_std_m + 0.02 * stated.height_m)
    focal = replace(lens, focal_px=3 * lens.focal_px + 0.02 * stated.camera.fx_px)
    centre = replace(lens, principal_point_px=3 * lens.principal_point_px + 5)
    for name, known in (("focal length", focal), ("principal point", centre)):
        yield name, replace(stated, camera=replace(stated.camera, std=known))


NEAR_A_LIMIT = (31, range(33, 35))
"""A seed, and two scenes: in the second a width is less within its limit than draws are noisy."""


@pytest.mark.parametrize(
    ("seed", "scenes"),
    [(2 * SAMPLE, range(SAMPLE)), NEAR_A_LIMIT, pytest.param(1600, range(800), marks=FULL.marks)],
    ids=["sample", "near a limit", "full"],
)
def test_nothing_that_is_refused_is_answered_when_a_std_grows(seed, scenes):
    rng, refused = np.random.default_rng(seed), 0
    for number in range(scenes.stop):
        stated, probes = Stated.drawn(rng), random_probes(rng)
        if number not in scenes:
            continue
        stated = replace(stated, std=replace(stated.std, tilt_rad=stated.std.tilt_rad + math.radians(3)))
        before = stated.answers(probes)
        at = [k for k, each in enumerate(before) if each.status is Status.ILL_CONDITIONED]
        for name, worse in worse_than(stated) if at else ():
            after = worse.answers([probes[k] for k in at])
            assert all(each.status is not Status.OK for each in after), (stated, name, [probes[k] for k in at])
            refused += len(at)
    assert refused > len(scenes)


@pytest.mark.parametrize(("scenes", "fewest"), [(60, 12), pytest.param(1500, 400, marks=FULL.marks)])
def test_what_is_not_upright_is_not_answered_when_a_std_grows(scenes, fewest):
    """Base and top of two objects, or interchanged: of 514 such scenes 167 were answered with one std grown."""
    rng, refused = np.random.default_rng(5), 0
    for _ in range(scenes):
        stated, base = Stated.drawn(rng), rng.uniform([60, 400], SIZE - 60)
        aside_px = rng.uniform(-200, 200) if rng.random() < 0.6 else 0.0
        probe = ProbeKind.HEIGHT, np.stack([base, base - [aside_px, rng.uniform(-60, 350)]])
        if stated.answers([probe])[0].status is Status.NOT_UPRIGHT:
            refused += 1
            for name, worse in worse_than(stated):
                assert worse.answers([probe])[0].status is not Status.OK, (stated, name, probe)
    assert refused >= fewest


@pytest.mark.parametrize("scenes", [10, pytest.param(300, marks=FULL.marks)])
@pytest.mark.parametrize("lens", ["straight", "bent"])
def test_intervals_hold_where_the_focal_length_is_known_to_a_quarter(lens, scenes, capsys):
    """The focal length enters as its inverse: taken linear, 89 to 92 % were held, and none missed on the near side."""
    rng, cells, near, far = np.random.default_rng(scenes), defaultdict(list), [], []
    while len(cells[ProbeKind.RANGE]) < scenes:
        stated = Stated.drawn(rng)
        if (stated.camera.name == "straight") != (lens == "straight"):
            continue
        camera = replace(stated.camera.std, focal_px=rng.uniform(0.2, 0.3) * stated.camera.fx_px)
        std = replace(stated.std, tilt_rad=min(stated.std.tilt_rad, 0.01), roll_rad=min(stated.std.roll_rad, 0.01))
        stated = replace(stated, camera=replace(stated.camera, std=camera), std=std, tilt_rad=rng.uniform(0, 0.9))
        probes = random_probes(rng)
        for (kind, pixels), answer in zip(probes, stated.answers(probes), strict=True):
            if answer.status is not Status.OK:
                continue
            noisy = pixels + stated.std_px * rng.standard_normal((DRAWS, *pixels.shape))
            values = stated.world(rng, DRAWS).values(kind, noisy)
            cells[kind].append(content(answer, values))
            if kind == ProbeKind.WIDTH:
                near.append(np.mean(values < answer.ci95[0]))
                far.append(np.mean(values > answer.ci95[1]))
    with capsys.disabled():
        print(f"\n{scenes} scenes, {lens} lens, focal length to 20 to 30 %: held", end="")
        print(", ".join(f" {kind} {np.mean(held):.1%}" for kind, held in sorted(cells.items())))
    for kind, held in cells.items():
        # an area's stated error reaches 0 beyond 41 %, and so does its interval
        assert 0.935 <= np.mean(held) <= (0.985 if kind == ProbeKind.AREA else 0.965), kind
    assert np.mean(near) >= 0.01
    assert np.mean(far) <= 0.04


def scaled(stated, share):
    """The same, with all stds of pose and pixels larger by a factor."""
    names = ("height_agl_m", "horizontal_m", "tilt_rad", "pan_rad", "roll_rad", "heading_rad")
    std = replace(stated.std, **{name: share * getattr(stated.std, name) for name in names})
    return replace(stated, std=std, std_px=share * stated.std_px)


def least_refused(stated, probe):
    """The same with stds that are just large enough for a refusal; None where none of them is, or the least."""
    answered, refused = 0.1, 10.0
    statuses = [scaled(stated, share).answers([probe])[0].status for share in (answered, refused)]
    if statuses != [Status.OK, Status.ILL_CONDITIONED]:
        return None
    for _ in range(12):
        share = math.sqrt(answered * refused)
        if scaled(stated, share).answers([probe])[0].status is Status.ILL_CONDITIONED:
            refused = share
        else:
            answered = share
    return scaled(stated, refused)


@pytest.mark.parametrize("scenes", [(14, 69), pytest.param(range(600), marks=FULL.marks)], ids=["sample", "full"])
def test_a_height_that_is_just_refused_stays_so_when_a_std_grows_by_little(scenes):
    limits = 0
    for seed in scenes:
        rng = np.random.default_rng(seed)
        stated = replace(Stated.drawn(rng), tilt_rad=math.radians(rng.uniform(0, 12)))
        base = rng.uniform([60, 400], SIZE - 60)
        probe = ProbeKind.HEIGHT, np.stack([base, base - [rng.uniform(-30, 30), rng.uniform(5, 350)]])
        stated = least_refused(stated, probe)
        for name in ("height_agl_m", "horizontal_m", "tilt_rad", "pan_rad", "roll_rad") if stated else ():
            limits += 1
            worse = replace(stated, std=replace(stated.std, **{name: 1.01 * getattr(stated.std, name) + 1e-5}))
            assert worse.answers([probe])[0].status is Status.ILL_CONDITIONED, (stated, name, probe)
    assert limits > len(scenes)


@pytest.mark.parametrize("heading_deg", [90, 180, 720, 1e11])
def test_an_unknown_heading_changes_what_depends_on_it_alone(heading_deg):
    rng = np.random.default_rng(5)
    for _ in range(10):
        stated = Stated.drawn(rng)
        probes = [each for each in random_probes(rng) if each[0] not in (ProbeKind.BEARING, ProbeKind.POSITION)]
        known = replace(stated, std=replace(stated.std, heading_rad=0.0, horizontal_m=0.0))
        unknown = replace(known, std=replace(known.std, heading_rad=math.radians(heading_deg), horizontal_m=1e5))
        for one, other in zip(known.answers(probes), unknown.answers(probes), strict=True):
            assert other.status is one.status
            if one.ci95 is not None:
                assert other.ci95 == pytest.approx(one.ci95, rel=1e-6, abs=1e-6)


def random_line(rng, count):
    """A line of so many vertices through the image, straight, curved, or with a corner at each of them."""
    steps_px = math.exp(rng.uniform(math.log(1.5), math.log(min(100, 900 / count))))
    course = rng.uniform(0, 2 * math.pi) + np.cumsum(rng.normal(size=count - 1)) * rng.choice([0.0, 0.05, 0.5])
    vertices = np.cumsum(steps_px * np.stack([np.cos(course), np.sin(course)], axis=-1), axis=0)
    vertices = np.concatenate([np.zeros((1, 2)), vertices])
    return vertices - vertices.mean(axis=0) + SIZE / 2


@pytest.mark.parametrize(("lines", "repeats"), [(8, 20), pytest.param(120, 40, marks=FULL.marks)])
def test_lines_are_as_long_as_they_are_however_many_vertices_have_noise(lines, repeats, capsys):
    rng, cells = np.random.default_rng(lines), defaultdict(list)
    for number in range(lines):
        stated = replace(Stated.drawn(rng), std_px=1.0, tilt_rad=math.radians(rng.uniform(0, 50)), roll_rad=0.0)
        stated = replace(stated.exact(), std_px=stated.std_px)
        count = [5, 20, 60, 200][number % 4]
        line = random_line(rng, count)
        (truth,) = stated.world(rng, 1).values(ProbeKind.LENGTH, line[None])
        noisy = [(ProbeKind.LENGTH, line + rng.normal(size=line.shape)) for _ in range(repeats)]
        answers = stated.answers(noisy)
        assert all(each.ci95[0] <= each.value <= each.ci95[1] for each in answers)
        cells[count] += [each.ci95[0] <= truth <= each.ci95[1] for each in answers]
    with capsys.disabled():
        shares = ", ".join(f"{count} vertices {np.mean(held):.1%}" for count, held in sorted(cells.items()))
        print(f"\n{lines} lines, {repeats} times with noise: held {shares}")
    assert np.mean(np.concatenate(list(cells.values()))) >= 0.92
    for held in cells.values():
        assert len(held) < 200 or np.mean(held) >= 0.9
