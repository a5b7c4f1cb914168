"""The wheel in an environment that has nothing else: what comes with it is found, and a flight is measured."""

import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

pytestmark = [pytest.mark.nightly, pytest.mark.timeout(1200)]

ROOT = Path(__file__).parents[2]
PYTHON = """
import aerodft as ad
camera = ad.load_camera("mine/camera.toml")
pose = ad.CameraPose(height_m=40, tilt_deg=30, std=ad.PoseStd(height_m=0.1, tilt_deg=0.2))
print(ad.measure(camera, pose, ad.Distance([(600, 700), (1300, 700)])).status)
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    subprocess.run([*pip, "wheel", "--no-deps", "-w", folder, ROOT], check=True)
    (wheel,) = folder.glob("aerodft-*.whl")
    venv.create(folder / "env", with_pip=True)
    own = [folder / "env/bin/python", "-m", "pip", "--disable-pip-version-check", "-q"]
    subprocess.run([*own, "install", "-c", ROOT / "constraints.txt", wheel], check=True)
    return folder / "env/bin"


def test_a_flight_from_the_wheel_alone(installed, tmp_path):
    """What README asks of a log, far from the repository; the camera comes from the library in the wheel."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    log = ROOT / "samples/copter.tlog"
    commands = (
        [installed / "aerodft", "init", log, "--camera", "Mini 4 Pro", "-o", "mine"],
        [installed / "aerodft", "import", log, "--config", "mine/station.toml", "-o", "recording"],
        [installed / "aerodft", "export", "recording", "--format", "csv", "-o", "measurements.csv"],
    )
    for command in commands:
        subprocess.run(command, cwd=tmp_path, env=clean, check=True)
    assert len((tmp_path / "measurements.csv").read_text().splitlines()) > 500
    told = subprocess.run(
        [installed / "python", "-c", PYTHON], cwd=tmp_path, env=clean, check=True, capture_output=True
    )
    assert told.stdout.split() == [b"ok"]
