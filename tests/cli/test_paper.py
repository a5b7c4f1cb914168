"""``aerodft paper`` as its user meets it."""

import json
import math

import cv2
import pytest


@pytest.fixture(scope="module")
def told(aerodft, tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    run = aerodft("paper", "-o", folder / "new", "--json")
    assert run.code == 0, run.err
    return folder / "new", run


def test_one_document_holds_every_table(told):
    folder, run = told
    document = json.loads(run.out)
    assert document["schema"] == "aerodft.paper/1"
    assert [len(document[f"table{n}"]["rows"]) for n in (1, 2, 3)] == [7, 10, 4]
    assert document["figure12"]["png"] == str(folder / "figure-12.png")
    for part in ("table1", "table2", "table3", "figure12", "figure14"):
        assert document[part]["notes"]


def test_degrees_and_percent_come_out(told):
    document = json.loads(told[1].out)
    cam1 = document["table1"]["rows"][0]
    assert cam1["printed_pitch_deg"] == 63.0
    assert cam1["pitch_for_z_150_deg"] == pytest.approx(math.degrees(math.acos(1 / 15)) - 22.65)
    last = document["table2"]["rows"][9]
    assert last["psi_deg"] == pytest.approx(math.degrees(math.acos(10.48 / 140.94)))
    assert last["psi_at_border_deg"] < last["psi_deg"]
    pitch = document["table3"]["rows"][0]
    assert pitch["printed_percent"] == {"X": 1.75, "Y": 1.75, "Z": 2.48}
    angles = {(true["psi_deg"], true["phi_deg"]) for true in pitch["true"]}
    assert {(30.0, 0.0), (60.0, 0.0), (85.0, 0.0)} <= angles


def test_curves_are_null_where_nothing_is_seen(told):
    curves = json.loads(told[1].out)["figure12"]["curves"]
    assert len(curves) == 7
    for curve in curves:
        assert curve["depth_m"] == list(range(10, 151, 10))
        assert curve["error_m"][0] is None
        assert curve["error_m"][-1] > 0.6


@pytest.mark.parametrize("name", ["figure-12.png", "figure-14.png"])
def test_figures_are_pictures(told, name):
    image = cv2.imread(str(told[0] / name))
    assert image.shape[0] > 400
    assert image.shape[1] > 600
    assert len({tuple(pixel) for pixel in image.reshape(-1, 3)[::7].tolist()}) > 20


def test_for_people_every_difference_has_its_sentence(aerodft, tmp_path):
    run = aerodft("paper", "-o", tmp_path)
    text = " ".join(run.out.decode().split())
    assert run.code == 0
    for said in (
        "Table 1", "Table 2", "Table 3", "Figure 12", "Figure 14", "Cam1 needs 63.53 deg", "131.8 m",
        "The paper prints no pixels", "cases 4 and 6", "tan(1 deg) = 1.75 %", "at psi = 0 alone", "sqrt(2) x 1.75",
        "Cam2 and Cam7", "0.5 m is reached at 131 m",
    ):  # fmt: skip
        assert said in text, said
    assert "drew" in run.err


def test_a_folder_that_cannot_be_is_one_sentence(aerodft, tmp_path):
    file = tmp_path / "file"
    file.touch()
    run = aerodft("paper", "-o", file / "under", "--json")
    assert (run.code, run.out) == (3, b"")
    assert "the figures cannot be written" in run.last
    assert str(file) in run.last


def test_help_has_an_example_and_json(aerodft):
    text = aerodft("paper", "--help").out.decode()
    assert "aerodft paper -o paper" in text
    assert "--json" in text
