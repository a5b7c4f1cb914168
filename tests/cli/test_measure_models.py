"""``aerodft measure --compare``: both models' own numbers, and differences that add up."""

import math
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from aerodft.adapters.config.camera import load_camera
from aerodft.cli.scenes.measure import cautions
from aerodft.geometry import camera_pose
from aerodft.model import PoseSample, Status

CANON = Path(__file__).parents[2] / "configs/cameras/canon-1000d.toml"
PIXELS = ("distance 1000,1296 2900,1296", "position 3000,900 elevation=0.5")


@pytest.fixture
def measure(aerodft):
    def run(tilt_deg, *options, probes=PIXELS):
        words = [word for probe in probes for word in ("--probe", probe)]
        return aerodft("measure", "--camera", CANON, "--height", 10.48, "--tilt", tilt_deg, *words, *options)

    return run


@pytest.mark.parametrize("tilt_deg", [0, 30, 67])
def test_both_lists_are_what_each_model_says_alone(measure, tilt_deg):
    both = measure(tilt_deg, "--compare", "--json")
    assert (both.code, both.err) == (0, "")
    assert both.json["pinhole"] == measure(tilt_deg, "--json").json
    assert both.json["dft"] == measure(tilt_deg, "--json", "--model", "dft").json


@pytest.mark.parametrize("tilt_deg", [0, 30, 67])
def test_differences_add_up(measure, tilt_deg):
    both = measure(tilt_deg, "--compare", "--json").json
    for pinhole, dft, between in zip(both["pinhole"], both["dft"], both["difference"], strict=True):
        assert (between["name"], between["kind"]) == (pinhole["name"], pinhole["kind"])
        for at, (there, here) in enumerate(zip(pinhole["ground_m"], dft["ground_m"], strict=True)):
            shift = [here[0] - there[0], here[1] - there[1]]
            assert_allclose(between["ground_m"][at], shift, atol=1e-12)
            assert_allclose(between["apart_m"][at], math.hypot(*shift), atol=1e-12)
            assert_allclose(
                between["apart_percent_of_range"][at], 100 * math.hypot(*shift) / pinhole["range_m"][at], rtol=1e-9
            )
            parts = [between["equation_5_m"][at] + between["angles_m"][at][0], between["angles_m"][at][1]]
            assert_allclose(parts, shift, atol=1e-12)
    width = both["difference"][0]
    assert_allclose(width["value"], both["dft"][0]["value"] - both["pinhole"][0]["value"])
    assert_allclose(width["percent"], 100 * width["value"] / both["pinhole"][0]["value"])
    assert both["difference"][1]["value"] is None


@pytest.mark.parametrize(("tilt_deg", "share"), [(0, 0.0), (30, 0.5), (67, math.sin(math.radians(67)))])
def test_equation_5_gives_the_sine_of_the_tilt_of_x_in_the_middle_row(measure, tilt_deg, share):
    """Row H/2: psi = theta, so X by Eq. 5 is sin(theta) of what the same angles mean."""
    both = measure(tilt_deg, "--compare", "--json").json
    by_paper = both["dft"][0]["ground_m"][0][0]
    by_angles = by_paper - both["difference"][0]["equation_5_m"][0]
    phi = (1000 - 1944) * math.radians(64.3) / 3888
    assert_allclose(by_angles, 10.48 * math.tan(phi) / math.cos(math.radians(tilt_deg)), rtol=1e-9)
    assert_allclose(by_paper, share * by_angles, atol=1e-9)
    table = measure(tilt_deg, "--compare").out.decode()
    assert f"Eq. 5 gives {share:.2f} of the true X" in " ".join(table.split())


def test_what_has_no_answer_has_no_difference(measure):
    found = measure(70, "--compare", "--json", probes=("range 3000,6", "range 1944,1296"))
    above, below = found.json["difference"]
    assert found.code == 0
    assert {above[key] for key in ("value", "percent", "ground_m", "equation_5_m", "angles_m")} == {None}
    assert below["value"] is not None
    assert "2.65 deg past the horizon, expected a tilt below 67.35 deg" in found.err
    assert measure(70, "--compare", probes=("range 3000,6",)).code == 4


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--compare", "--model", "dft"), "--model beside --compare"),
        (("--compare", "--roll", "2"), "--roll with --compare"),
        (("--model", "dft", "--roll", "2"), "--roll with --model dft"),
    ],
)
def test_what_cannot_be_compared_is_usage(measure, options, said):
    found = measure(30, *options)
    assert (found.code, found.out) == (2, b"")
    assert said in found.last


def test_a_recording_is_compared_as_well(aerodft, flight_recording):
    found = aerodft(
        "measure", "--recording", flight_recording, "--at", "1", "--probe", "range 31,23", "--compare", "--json"
    )
    assert (found.code, found.err) == (0, "")
    assert [m["model"] for m in (found.json["pinhole"][0], found.json["dft"][0])] == ["pinhole", "dft"]


def test_a_roll_that_dft_leaves_out_is_said():
    canon = load_camera(CANON)
    rolled = camera_pose(height_agl_m=10.0, tilt_rad=0.5, roll_rad=math.radians(-3.0))
    (said,) = cautions(canon, PoseSample(stamp_ns=0, status=Status.OK, pose=rolled))
    assert said == "the paper's camera does not roll: a roll of -3.0 deg is left out under dft"
    assert cautions(canon, PoseSample(stamp_ns=0, status=Status.NO_HEIGHT)) == []
