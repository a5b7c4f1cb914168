"""What people mix up in evidence is found, named in one sentence, and leaves no file behind."""

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer

from tests.nights import at_night

from .calibration_scene import (
    AXES,
    EYE_M,
    HEADING_DEG,
    HEIGHT_PX,
    POSE,
    RD_M,
    TILT_DEG,
    WIDTH_PX,
    Field,
    calibrate,
    landmarks,
    pixels_of,
)
from .conftest import run_aerodft

FIELD = Field.of()
GRID = FIELD.places + RD_M
LAT_LON = np.column_stack(
    [
        *Transformer.from_crs("EPSG:28992", "EPSG:4326").transform(GRID[:, 0], GRID[:, 1]),
        GRID[:, 2],
    ]
)
LOCAL, RD, GEO = 'crs = "local"\n', 'crs = "EPSG:28992"\n', 'crs = "geo"\n'
PIXELS, PLACES = FIELD.pixels, FIELD.places


def camera(keys):
    return f"[camera]\n{keys}\n"


def with_columns(values, **columns):
    changed = values.copy()
    for index, column in columns.items():
        changed[:, int(index[1:])] = column
    return changed


def moved(values, rows, by):
    changed = values.copy()
    changed[rows] += by
    return changed


def refused(tmp_path, text, code, *sentences, **how):
    run, output = calibrate(tmp_path, text, **how)
    assert run.code == code, run.err
    for sentence in sentences:
        assert sentence in run.last
    assert "Traceback" not in run.err
    assert "nan" not in run.last.lower()
    assert not output.exists()


def test_sound_evidence_is_not_refused(tmp_path):
    for text in (
        LOCAL + landmarks(PIXELS, PLACES),
        RD + landmarks(PIXELS, GRID),
        GEO + landmarks(PIXELS, LAT_LON, in_degrees=True),
    ):
        run, output = calibrate(tmp_path, text, "--json")
        assert run.code == 0, run.err
        assert output.is_file()
        tilt = run.json["parameters"]["tilt_deg"]
        assert abs(tilt["value"] - TILT_DEG) < 4 * tilt["std"]


SWAPPED = FIELD.places + [500.0, 500.0, 0.0]
UPRIGHT = PIXELS[:, 0] < HEIGHT_PX - 1


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (LOCAL + landmarks(SWAPPED[:, :2], np.column_stack([PIXELS, SWAPPED[:, 2]])), "pixels and places look inter"),
        (LOCAL + landmarks(GRID[:, :2], np.column_stack([PIXELS, GRID[:, 2]])), "pixels and places: they look inter"),
        (LOCAL + landmarks(PIXELS, PLACES[:, [1, 0, 2]]), "x and y of the landmarks look interchanged"),
        (GEO + landmarks(PIXELS, LAT_LON[:, [1, 0, 2]], in_degrees=True), "latitude and longitude of the landmarks"),
        (RD + landmarks(PIXELS, GRID[:, [1, 0, 2]]), "swap them: easting comes first"),
        (LOCAL + landmarks(PIXELS[UPRIGHT][:, ::-1], PLACES[UPRIGHT]), "u and v look interchanged"),
        (
            LOCAL + landmarks(with_columns(PIXELS, c1=HEIGHT_PX - 1 - PIXELS[:, 1]), PLACES),
            "v looks as if counted from",
        ),
        (LOCAL + landmarks(np.roll(PIXELS, 1, axis=0), PLACES), "belonged to the previous landmark"),
        (LOCAL + landmarks(PIXELS[[1, 0, *range(2, 9)]], PLACES), "landmark[0] and landmark[1] look interchanged"),
    ],
    ids=["columns", "columns-rd", "x-y", "lat-lon", "rd", "u-v", "v-up", "rows", "two-pixels"],
)
def test_what_is_swapped_is_found_by_trying(tmp_path, text, sentence):
    refused(tmp_path, text, 3, sentence)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (RD + landmarks(PIXELS, moved(GRID, slice(0, 9, 2), [0, 0, 47])), "height: got 47.0 m "),
        (RD + landmarks(PIXELS, moved(GRID, [3], [0, 0, 47])), "p4: height: got 47.0 m above where"),
        (RD + landmarks(PIXELS, moved(GRID, [3, 5], [-95.0, 110.0, 0])), "p4 and p6: place: got 9"),
        (
            RD + camera("position_m = { value = [155003.0, 462995.0, 69.0], std = 0.5 }") + landmarks(PIXELS, GRID),
            "height_agl_m contradicts the observations",
        ),
        (
            RD + camera("position_m = { value = [155098.0, 462885.0], std = 1.0 }") + landmarks(PIXELS, GRID),
            "are places of two datums",
        ),
        (RD + landmarks(PIXELS, LAT_LON), "they look like degrees"),
        (LOCAL + landmarks(PIXELS, LAT_LON), 'with crs = "geo"'),
        (LOCAL + landmarks(PIXELS, PLACES * [1, 1, 1 / 0.3048]), "heights look like feet"),
        (LOCAL + landmarks(PIXELS, PLACES * [1, 1, -1]), "look like depths"),
        (GEO + landmarks(PIXELS, LAT_LON * [math.pi / 180, math.pi / 180, 1], in_degrees=True), "from radians"),
        ('crs = "EPSG:31370"\n' + landmarks(PIXELS, GRID), "Belgian Lambert 72"),
        ('crs = "EPSG:28991"\n' + landmarks(PIXELS, GRID), "RD Old"),
    ],
    ids=[
        "heights-half", "height-one", "shift", "camera-height", "camera-place", "degrees-as-rd", "degrees-as-local",
        "feet", "depths", "radians", "belgian", "rd-old",
    ],
)  # fmt: skip
def test_mixed_datums_units_and_systems_are_named(tmp_path, text, sentence):
    refused(tmp_path, text, 3, sentence)


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        (f"tilt_deg = {{ value = {math.radians(TILT_DEG):.3f}, std = 2.0 }}", "it looks like radians"),
        (f"heading_deg = {{ value = {math.radians(HEADING_DEG):.3f}, std = 2.0 }}", "it looks like radians"),
        (f"tilt_deg = {{ value = {90 - TILT_DEG}, std = 2.0 }}", "angle below the horizon"),
        (f"height_agl_m = {{ value = {EYE_M[2] / 0.3048:.1f}, std = 0.3 }}", "it looks like feet"),
        ("height_agl_m = { value = 120.0, std = 0.5 }", "got 120 +- 0.5, expected about 12"),
        ("position_m = { value = [100.0, 100.0], std = 0.5 }", "position contradicts the observations: got [100, 100]"),
        ("focal_px = { value = 24.0, std = 1.0 }", "it looks like millimetres"),
    ],
)
def test_priors_that_all_else_contradicts_are_named(tmp_path, keys, sentence):
    refused(tmp_path, LOCAL + camera(keys) + landmarks(PIXELS, PLACES), 3, "contradicts the observations", sentence)


def test_an_exact_tilt_in_radians_is_named_where_it_is_not_asked_for(tmp_path):
    text = LOCAL + camera("tilt_deg = 1.047") + landmarks(PIXELS, PLACES)
    refused(tmp_path, text, 3, "tilt_deg contradicts", "radians", unknowns="position,height,roll,heading")


def test_a_prior_that_is_right_is_kept(tmp_path):
    text = LOCAL + camera("tilt_deg = { value = 57.0, std = 2.0 }") + landmarks(PIXELS, PLACES)
    assert calibrate(tmp_path, text)[0].code == 0


BEHIND = EYE_M * [1, 1, 0] - AXES[2] * [20, 20, 0]
HIGH = [*(EYE_M + 30 * AXES[2])[:2], 30.0]


@pytest.mark.parametrize(
    ("place", "sentence"), [(BEHIND, "its place is behind the camera"), (HIGH, "its place is above the horizon")]
)
def test_a_landmark_that_cannot_be_seen_is_refused_by_name(tmp_path, place, sentence):
    text = LOCAL + landmarks(PIXELS, np.vstack([PLACES[:-1], place]))
    refused(tmp_path, text, 3, "landmark[8]", sentence, "p9")


def test_a_far_off_pixel_of_a_place_in_view_is_rejected_by_name(tmp_path):
    run, output = calibrate(tmp_path, LOCAL + landmarks(moved(PIXELS, [4], [-60.0, 35.0]), PLACES))
    assert run.code == 0, run.err
    assert "Rejected p5: it is 69 px from" in run.err
    assert output.is_file()


def test_too_few_and_collinear_landmarks_are_told(tmp_path):
    refused(tmp_path, LOCAL + landmarks(PIXELS[:2], PLACES[:2]), 4, "4 numbers for 6 unknowns")
    line = PLACES[0] + np.linspace(0, 1, 6)[:, None] * (PLACES[3] - PLACES[0])
    refused(tmp_path, LOCAL + landmarks(pixels_of(line), line), 4, "all landmarks lie in one line")


def test_unknowns_that_nobody_stated_are_proposed(tmp_path):
    text = LOCAL + landmarks(PIXELS, PLACES)
    refused(tmp_path, text, 4, "--unknowns height,tilt,position,roll,heading", unknowns="height,tilt")


def test_another_mode_of_the_camera_is_named(tmp_path):
    centre = np.array([WIDTH_PX - 1, HEIGHT_PX - 1]) / 2
    zoomed = (PIXELS - centre) * 0.77 + centre
    refused(tmp_path, LOCAL + landmarks(zoomed, PLACES), 3, "not of this camera's mode", "focal length of 115")
    refused(tmp_path, LOCAL + landmarks((PIXELS + 0.5) / 2 - 0.5, PLACES), 3, "an image of 960 x 540")
    sized = LOCAL + "[image]\nwidth_px = 3840\nheight_px = 2160\n" + landmarks(PIXELS, PLACES)
    refused(tmp_path, sized, 3, "got 3840 x 2160 pixels")


@pytest.mark.parametrize(
    ("unknowns", "sentence"),
    [
        ("height,tilt,height", "height twice"),
        ("position,east", "east twice"),
        ("heigth", "did you mean height?"),
        ("tilt_deg", "did you mean tilt?"),
        ("height,pitch", "did you mean tilt"),
        (f"{POSE},k9", "got k9"),
        ("", "none"),
    ],
)
def test_unknowns_that_make_no_sense_are_misuse(tmp_path, unknowns, sentence):
    refused(tmp_path, LOCAL + landmarks(PIXELS, PLACES), 2, "--unknowns", sentence, unknowns=unknowns)


def test_a_place_above_the_horizon_is_refused_though_another_landmark_is_off_too(tmp_path):
    strays = np.vstack([PLACES[:-2], HIGH, PLACES[-1]])
    text = LOCAL + landmarks(moved(PIXELS, [8], [-80.0, 60.0]), strays)
    refused(tmp_path, text, 3, "landmark[7]", "its place is above the horizon", "p8")


def test_the_example_says_what_to_ask_for(tmp_path):
    root = Path(__file__).parents[2] / "configs"
    run = run_aerodft(
        "calibrate", root / "calibration" / "bridge-landmarks.toml", "--camera", root / "cameras" / "demo-1080p.toml",
        "-o", tmp_path / "bridge.toml", "--json",
    )  # fmt: skip
    assert run.code == 4
    assert run.json["status"] == "ILL_CONDITIONED"
    assert "--unknowns height,tilt,position,roll,heading, with which all fits to 0." in run.last
    assert not (tmp_path / "bridge.toml").exists()


@pytest.mark.parametrize("seed", [0, *at_night(1, 2, 3, 4)])
def test_noise_five_times_as_large_as_stated_is_nobodys_mistake(tmp_path, seed):
    field, rng = Field.of(count=8, seed=seed), np.random.default_rng(seed)
    text = LOCAL + landmarks(field.pixels + rng.normal(0.0, 2.4, field.pixels.shape), field.places)
    run, output = calibrate(tmp_path, text, "--json")
    assert run.code == 0, run.err
    assert output.is_file()
    assert abs(run.json["parameters"]["tilt_deg"]["value"] - TILT_DEG) < 1.0


RANGES = "".join(
    f"[[range]]\npixel = [{u}.0, {v}.0]\nrange_m = {range_m}\nstd_m = 0.05\n"
    for u, v, range_m in ((960, 500, 24.9), (960, 800, 17.9), (500, 800, 18.6))
)
HORIZON = "[[horizon]]\npixels = [[0.0, -300.0], [1919.0, -320.0]]\n"


@pytest.mark.parametrize(
    ("unknowns", "sentence"),
    [
        ("height", "got a tilt that is neither stated nor asked for, expected tilt_deg under [camera]"),
        ("tilt", "got a height that is neither stated nor asked for, expected height_agl_m under [camera]"),
    ],
)
def test_no_height_and_no_tilt_is_made_up(tmp_path, unknowns, sentence):
    refused(tmp_path, LOCAL + RANGES, 4, sentence, f"--unknowns {unknowns}", unknowns=unknowns)


def test_a_horizon_tells_tilt_and_roll_at_any_height_but_no_pose_for_a_file(tmp_path):
    refused(tmp_path, LOCAL + HORIZON, 4, "got a height that is neither stated", unknowns="tilt,roll")
    evidence, lens = tmp_path / "evidence.toml", tmp_path / "camera.toml"
    run = run_aerodft("calibrate", evidence, "--camera", lens, "--unknowns", "tilt,roll", "--json")
    assert run.code == 0, run.err
    assert set(run.json["parameters"]) == {"tilt_deg", "roll_deg"}
    stated = camera("height_agl_m = 12.0")
    run, output = calibrate(tmp_path, LOCAL + HORIZON + stated, unknowns="tilt,roll")
    assert run.code == 0, run.err
    assert output.is_file()


def test_many_points_off_by_more_than_their_stds_may_be_of_a_bent_lens(tmp_path):
    many, rng = Field.of(16), np.random.default_rng(1)
    text = LOCAL + landmarks(many.pixels + rng.normal(0.0, 8.0, (16, 2)), many.places)
    run, _ = calibrate(tmp_path, text, "--accept-misfit", unknowns=f"{POSE},focal")
    assert "times as large as the stated stds" in run.err
    assert "told by k1 and k2 in --unknowns" in run.err
    (tmp_path / "calibration.toml").unlink()
    run, _ = calibrate(tmp_path, text, "--accept-misfit", unknowns=f"{POSE},focal,k1,k2")
    assert "told by k1 and k2" not in run.err


@pytest.mark.parametrize(
    ("seed", "noise_px", "why"), [(1, 20.0, "contradict"), (10, 8.0, "by the stated stds they could")]
)
def test_four_points_off_by_more_than_their_stds_are_taken_on_demand(tmp_path, seed, noise_px, why):
    """Eight numbers for seven unknowns: the figure is the root of chi-square by degrees of freedom.

    At the second seed a camera that stands on its head, 92 m high, would fit as well.
    """
    few, rng = Field.of(4, seed), np.random.default_rng(seed)
    text = LOCAL + landmarks(few.pixels + rng.normal(0.0, noise_px, (4, 2)), few.places)
    run, output = calibrate(tmp_path, text, unknowns=f"{POSE},focal")
    assert (run.code, run.out) == (4, b"")
    assert why in run.last
    assert not output.exists()
    run, output = calibrate(tmp_path, text, "--accept-misfit", "--json", unknowns=f"{POSE},focal")
    assert run.code == 0, run.err
    document, provenance = run.json, tomllib.loads(output.read_text())["provenance"]
    assert document["degrees_of_freedom"] == 1
    assert document["misfit"] == pytest.approx(math.sqrt(document["chi2"]))
    assert f"residuals are {document['misfit']:.3g} times as large as the stated stds" in run.err
    assert provenance["misfit_accepted"] is True
    assert provenance["misfit"] == pytest.approx(document["misfit"])
    truth = {"height_agl_m": EYE_M[2], "tilt_deg": TILT_DEG, "heading_deg": HEADING_DEG}
    for name, value in truth.items():
        found = document["parameters"][name]
        assert abs(found["value"] - value) < 1.96 * found["std"], name


def test_a_misfit_that_leaves_the_camera_anywhere_is_not_taken(tmp_path):
    """60 px off, and stds that are stated as 0.5: scaled, the height's is 58 times the height."""
    few, rng = Field.of(4, 9), np.random.default_rng(9)
    text = LOCAL + landmarks(few.pixels + rng.normal(0.0, 60.0, (4, 2)), few.places)
    run, output = calibrate(tmp_path, text, "--accept-misfit", unknowns=f"{POSE},focal")
    assert (run.code, run.out) == (4, b"")
    assert "cannot be told apart" in run.last
    assert "times as large as the stated stds" in run.last
    assert "--accept-misfit" not in run.last
    assert not output.exists()
