"""Calibrations from Python: what is refused is raised, and what is found can be read and saved."""

from pathlib import Path

import numpy as np
import pytest

import aerodft as ad
from aerodft.adapters.config.camera import load_calibration, load_camera

CONFIGS = Path(__file__).parents[2] / "configs"
BRIDGE = CONFIGS / "calibration" / "bridge-landmarks.toml"
CAMERA = CONFIGS / "cameras" / "demo-1080p.toml"
POSE = ("position", "height", "tilt", "roll", "heading", "focal")


def test_a_calibration_is_read_and_saved(tmp_path):
    found = ad.calibrate(BRIDGE, load_camera(CAMERA), POSE)
    document = found.document()
    assert found.values == {name: each["value"] for name, each in document["parameters"].items()}
    assert found.stds == {name: each["std"] for name, each in document["parameters"].items()}
    assert np.array_equal(np.sqrt(np.diag(found.covariance)), list(found.stds.values()))
    found.save(tmp_path / "bridge.toml")
    saved = load_calibration(tmp_path / "bridge.toml")
    assert np.degrees(saved.pose.tilt_rad) == pytest.approx(found.values["tilt_deg"])
    assert saved.camera.fx_px == found.camera.fx_px


def test_what_is_not_determined_is_raised_and_not_saved(tmp_path):
    with pytest.raises(ad.NotDetermined) as refused:
        ad.calibrate(BRIDGE, CAMERA, ["height", "tilt"])
    assert refused.value.got == "neither position nor roll nor heading stated or asked for"
    found = ad.calibrate(BRIDGE, CAMERA, ["height", "tilt"], check=False)
    assert found.refusal().got == refused.value.got
    with pytest.raises(ad.NotDetermined):
        found.save(tmp_path / "bridge.toml")
    assert not (tmp_path / "bridge.toml").exists()
