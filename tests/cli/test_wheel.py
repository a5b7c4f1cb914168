"""The wheel in an environment that has nothing else: what comes with it is found, and a flight is measured."""

import os
import subprocess
import sys
import zipfile

import pytest

from tests.environments import ROOT, build_wheel, make_environment

pytestmark = [pytest.mark.nightly, pytest.mark.timeout(1200)]

PACKAGES = ("aerodft/", "calibration/", "replay/")
NOT_SHIPPED = {"aerodft/web/types.d.ts"}  # for who works on the page
PYTHON = """
import aerodft as ad
camera = ad.load_camera("mine/camera.toml")
pose = ad.CameraPose(height_m=40, tilt_deg=30, std=ad.PoseStd(height_m=0.1, tilt_deg=0.2))
print(ad.measure(camera, pose, ad.Distance([(600, 700), (1300, 700)])).status)
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return build_wheel(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def installed(wheel):
    folder = wheel.parent / "env"
    return make_environment(folder, sys.executable, "--constraint", ROOT / "constraints.txt", wheel).parent


def test_every_file_of_the_packages_is_in_the_wheel(wheel):
    words = ["git", "ls-files", *PACKAGES]
    tracked = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\n")
    there = {each for each in tracked if each and (ROOT / each).is_file()}
    packed = {each for each in zipfile.ZipFile(wheel).namelist() if each.startswith(PACKAGES)}
    assert packed == there - NOT_SHIPPED


def test_a_flight_from_the_wheel_alone(installed, tmp_path):
    """What README asks of a log, far from the repository; camera and page's templates come from the wheel."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    log = ROOT / "samples/copter.tlog"
    commands = (
        [installed / "aerodft", "init", log, "--camera", "Mini 4 Pro", "-o", "mine"],
        [installed / "aerodft", "import", log, "--config", "mine/station.toml", "-o", "recording"],
        [installed / "aerodft", "export", "recording", "--format", "csv", "-o", "measurements.csv"],
        [installed / "aerodft", "report", "recording", "-o", "report.html"],
    )
    for command in commands:
        subprocess.run(command, cwd=tmp_path, env=clean, check=True)
    assert len((tmp_path / "measurements.csv").read_text().splitlines()) > 500
    assert "<h2>Provenance</h2>" in (tmp_path / "report.html").read_text(encoding="utf-8")
    told = subprocess.run(
        [installed / "python", "-c", PYTHON], cwd=tmp_path, env=clean, check=True, capture_output=True
    )
    assert told.stdout.split() == [b"ok"]
