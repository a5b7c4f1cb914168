"""Places come back in the coordinates that they were stated in, to people, in JSON and in the calibration file."""

import re
import tomllib

import numpy as np
import pytest

from .calibration_scene import EYE_M, HEADING_DEG, POSE, RD_M, Field, calibrate, landmarks, pixels_of

FIELD = Field.of()
FAR_M = np.array([533_000.0, 5_212_000.0, 0.0])


def figures(run):
    return {key: (each["value"], each["std"]) for key, each in run.json["parameters"].items()}


@pytest.mark.parametrize(("crs", "shift_m"), [("EPSG:28992", RD_M), ("local", FAR_M)])
def test_east_and_north_are_those_of_the_file(tmp_path, crs, shift_m):
    run, output = calibrate(tmp_path, f'crs = "{crs}"\n' + landmarks(FIELD.pixels, FIELD.places + shift_m), "--json")
    assert run.code == 0, run.err
    found = figures(run)
    for key, want in zip(("east_m", "north_m"), EYE_M + shift_m, strict=False):
        value, std = found[key]
        assert abs(value - want) < 4 * std
    np.testing.assert_allclose(run.json["position"][:2], [found["east_m"][0], found["north_m"][0]], atol=1e-9)
    pose = tomllib.loads(output.read_text())["pose"]
    if crs == "local":
        np.testing.assert_allclose([pose["east_m"], pose["north_m"]], run.json["position"][:2], atol=1e-9)
    else:
        assert "east_m" not in pose


def test_an_unknown_elevation_of_the_ground_is_in_the_files_heights(tmp_path):
    """Stated to a metre, and told to centimetres by ranges to the ground."""
    up_m, heading = RD_M[2], np.radians(HEADING_DEG)
    ahead = EYE_M + 15.0 * np.array([np.sin(heading), np.cos(heading), 0.0])
    u, v = pixels_of(np.array([[*ahead[:2], 0.0]]))[0]
    ranges = f"[[range]]\npixel = [{u:.2f}, {v:.2f}]\nrange_m = {np.hypot(15.0, EYE_M[2]):.4f}\nstd_m = 0.01\n"
    text = f'crs = "EPSG:28992"\nelevation_m = {{ value = {up_m + 0.7}, std = 1.0 }}\n'
    text += landmarks(FIELD.pixels, FIELD.places + RD_M) + ranges
    run, _ = calibrate(tmp_path, text, "--json", unknowns=f"{POSE},elevation")
    assert run.code == 0, run.err
    value, std = figures(run)["elevation_m"]
    assert std < 0.1
    assert abs(value - up_m) < 4 * std
    height, std = figures(run)["height_agl_m"]
    assert abs(height - EYE_M[2]) < 4 * std


def test_the_table_shows_what_the_std_leaves_of_large_coordinates(tmp_path):
    run, _ = calibrate(tmp_path, 'crs = "local"\n' + landmarks(FIELD.pixels, FIELD.places + FAR_M))
    assert run.code == 0, run.err
    row = next(line for line in run.out.decode().splitlines() if "east_m" in line)
    value, std = (float(cell) for cell in re.findall(r"[\d.]+", row))
    assert value == pytest.approx(FAR_M[0] + EYE_M[0], abs=4 * std)
    assert value != round(value)
