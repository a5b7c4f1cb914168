"""Points of one probe at different heights: intervals against Monte-Carlo, and distances of surveyed points.

Juncal is RIVeR's example, a drone's image of a river with 45 surveyed points, 2 m between the lowest and the highest.
"""

from collections import defaultdict
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from aerodft.model import ProbeKind, Status

from .calibration_files import aerodft, write_camera, write_landmarks
from .stated import DRAWS, Stated, content, random_probes, some
from .test_calibration_real import DATA, POSE, juncal

SAMPLE, FULL = 12, pytest.param(400, marks=[pytest.mark.nightly, pytest.mark.timeout(1800)])


def random_heights(rng, stated, kind, count):
    """Elevations and standard deviations, one for each of ``count`` points; of a river sometimes two: left, right."""
    number = 2 if kind == ProbeKind.RIVER and rng.random() < 0.5 else count
    std_m = [stated.height_m * some(rng, 0.001, 0.05) for _ in range(number)]
    return rng.uniform(-0.2, 0.4, number) * stated.height_m, np.array(std_m)


@pytest.mark.parametrize("scenes", [SAMPLE, FULL])
def test_intervals_hold_what_is_drawn_where_each_point_has_a_height_of_its_own(scenes, capsys):
    rng, cells = np.random.default_rng(scenes), defaultdict(list)
    for _ in range(scenes):
        stated = Stated.drawn(rng)
        probes = [each for each in random_probes(rng) if len(each[1]) > 1 and each[0] != ProbeKind.HEIGHT]
        heights = [random_heights(rng, stated, kind, len(pixels)) for kind, pixels in probes]
        answers = stated.answers_at(probes, heights)
        for (kind, pixels), (elevation_m, std_m), answer in zip(probes, heights, answers, strict=True):
            if answer.status is not Status.OK:
                continue
            planes_m = elevation_m + std_m * rng.standard_normal((DRAWS, len(std_m)))
            world = replace(stated.world(rng, DRAWS), plane_m=planes_m[:, np.arange(len(pixels)) % len(std_m)])
            noisy = pixels + stated.std_px * rng.standard_normal((DRAWS, *pixels.shape))
            held = content(answer, world.values(kind, noisy))
            cells[kind].append(held)
            assert held >= 0.9, (stated, kind, pixels, elevation_m, std_m, answer.value, answer.ci95)
    with capsys.disabled():
        print(f"\n{scenes} scenes: share of draws that intervals hold, least, mean, most, answers")
        for kind, held in sorted(cells.items()):
            print(f"  {kind:10s} {min(held):6.1%} {np.mean(held):6.1%} {max(held):6.1%} {len(held):5d}")
    assert set(cells) == {"distance", "width", "length", "area", "bearing", "river"}
    for kind, held in cells.items():
        assert 0.94 <= np.mean(held) <= 0.96 + 0.01 * (scenes == SAMPLE), kind


@pytest.fixture(scope="module")
def surveyed(tmp_path_factory):
    """Juncal calibrated with every second point; the file of all of them, and the pairs of the others."""
    if not DATA.is_dir():
        pytest.skip(f"{DATA} is not there: the surveyed images are kept apart")
    folder, survey = tmp_path_factory.mktemp("juncal"), juncal()
    camera = write_camera(folder / "camera.toml", survey.camera)
    everything = write_landmarks(folder / "all.csv", survey.points_m, survey.pixels, 5.0)
    head, *lines = everything.read_text().splitlines()
    (folder / "used.csv").write_text("\n".join([head, *lines[::2]]) + "\n")
    unknowns = f"{POSE},focal,k1,k2"
    made = aerodft(
        "calibrate", folder / "used.csv", "--camera", camera, "--unknowns", unknowns, "-o", folder / "c.toml"
    )
    assert made.code == 0, made.words
    up_m = survey.points_m[:, 2]
    pairs = [pair for pair in combinations(range(1, 45, 2), 2) if abs(np.diff(up_m[list(pair)])[0]) > 0.5]
    return folder, survey, pairs


def distances(folder, words, *options):
    probes = [word for each in words for word in ("--probe", f"distance {each}")]
    answer = aerodft("measure", "--calibration", folder / "c.toml", "--std", "px=5", *options, *probes)
    assert answer.code == 0, answer.words
    return answer.document


def test_distances_of_surveyed_points_hold_where_the_points_bring_their_heights(surveyed):
    """None of these points is in the calibration; taken to lie on one plane, 5 of 76 hold, 6 m off in the median."""
    folder, survey, pairs = surveyed
    truths_m = np.array([np.hypot(*(survey.points_m[i] - survey.points_m[j])[:2]) for i, j in pairs])
    found = distances(folder, [f"@p{i + 1} @p{j + 1}" for i, j in pairs], "--landmarks", folder / "all.csv")
    low, high = np.array([each["ci95"] for each in found]).T
    assert len(pairs) > 50
    assert np.mean((low <= truths_m) & (truths_m <= high)) >= 0.94
    assert np.median(np.abs([each["value"] for each in found] - truths_m)) < 0.4
    pixels = [" ".join(f"{u},{v}" for u, v in survey.pixels[[i, j]]) for i, j in pairs]
    on_one_plane = np.array([each["value"] for each in distances(folder, pixels)])
    assert np.median(np.abs(on_one_plane - truths_m)) > 4.0


def test_a_calibration_knows_the_points_that_it_was_made_from(surveyed):
    folder, survey, _ = surveyed
    (u, v), (x, y) = survey.pixels[[0, 2]].tolist()
    zero_m = float(np.median(survey.points_m[::2, 2]))
    heights = ",".join(repr(float(each - zero_m)) for each in survey.points_m[[0, 2], 2])
    named, typed = distances(folder, ["@p1 @p3", f"{u},{v} {x},{y} elevation={heights}"])
    moved, _ = distances(folder, [f"{u + 1},{v}@p1 @p3", "@p1 @p3"])
    assert named["pixels"] == typed["pixels"] == [[u, v], [x, y]]
    assert named["value"] == pytest.approx(typed["value"], rel=1e-9)
    assert moved["pixels"][0] == [u + 1, v]
    assert [z for *_, z in moved["ground_m"]] == [z for *_, z in named["ground_m"]]


@pytest.mark.parametrize(
    ("probe", "said"),
    [
        ("distance @p1 @p2", "got @p2, expected one of p1, p3, p5"),
        ("distance @p1 900,800 elevation=1,2", "expected one elevation, of the end without a name"),
        ("distance 900,800 950,800 elevation=p1,2", "or the name of one height"),
        (
            "distance 900,800 950,800 elevation=1,2,3",
            "got 3 elevations, expected one elevation, or 2, one for each point",
        ),
        ("height 900,800 900,700 elevation=1,2", "got 2 elevations, expected one elevation of height"),
        ("area 1,2 3,4 5,9 elevation=1,2,3 elevation_std=1,2", "got 3 elevations and 2 standard deviations"),
    ],
)
def test_what_does_not_fit_is_a_sentence_that_says_what_to_write(surveyed, probe, said):
    answer = aerodft("measure", "--calibration", surveyed[0] / "c.toml", "--probe", probe)
    assert answer.code == 2
    assert said in answer.words
