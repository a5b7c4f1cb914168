"""``aerodft demo`` as a newcomer runs it, only shorter."""

import csv
import json
import subprocess
import sys

import cv2
import pytest

PATIENCE_S = 150.0


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    out = tmp_path_factory.mktemp("demo") / "demo"
    command = [sys.executable, "-m", "aerodft", "demo", "--output", str(out), "--duration", "6", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stderr
    return out, done


def test_it_shows_truth_beside_measurement(shown):
    _, done = shown
    table, document = done.stdout.split("\n{", maxsplit=1)
    result = json.loads("{" + document)
    assert result["identical"] is True
    assert result["received"] > 0
    assert result["probes"]
    for name, row in result["probes"].items():
        assert name in table
        assert row["measured_m"] == pytest.approx(row["truth_m"], rel=0.1)
        assert row["inside"] == (row["ci95_m"][0] <= row["truth_m"] <= row["ci95_m"][1])


def test_it_leaves_pictures_tables_and_the_recording(shown):
    out, done = shown
    for picture in ("annotated.png", "widths.png"):
        image = cv2.imread(str(out / picture))
        assert image is not None
        assert image.std() > 10  # something is in it
    with (out / "measurements.csv").open(encoding="utf-8") as lines:
        assert {row["name"] for row in csv.DictReader(lines)} >= {"centre"}
    assert json.loads((out / "measurements.geojson").read_text())["features"]
    assert list((out / "recording").glob("data_*.mcap"))
    assert "the same bytes" in done.stderr
    assert "look at" in done.stderr


def test_it_spares_what_it_did_not_make(aerodft, tmp_path):
    (tmp_path / "thesis.txt").write_text("years of work")
    done = aerodft("demo", "--output", tmp_path)
    assert done.code == 3
    assert str(tmp_path) in done.last
    assert (tmp_path / "thesis.txt").read_text() == "years of work"
