import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from aerodft.geometry import inverse, matrix
from aerodft.model import ProbeKind
from aerodft.sim import default_camera
from aerodft.sim.observations import MARGIN_PX, ObserverModel, Sighting, sightings, write_lines
from aerodft.sim.scenario import Scenario, survey_scenario


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return survey_scenario(default_camera(1280, 720), duration_s=10.0, fps=5.0)


@pytest.fixture(scope="module")
def seen(scenario: Scenario) -> list[Sighting]:
    return look(scenario, scenario.observing)


def look(scenario: Scenario, observing: ObserverModel) -> list[Sighting]:
    stamps = scenario.image_stamps_ns.tolist()
    return list(sightings(scenario.world, scenario.camera, scenario.trajectory, stamps, observing))


def test_true_pixels_are_opencvs(scenario: Scenario, seen: list[Sighting]) -> None:
    camera = scenario.camera
    k = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    assert len(seen) > 50
    for each in seen:
        cam_from_enu = matrix(inverse(each.pose.wxyz))
        translation = -cam_from_enu @ each.pose.position_enu_m
        pixels, _ = cv2.projectPoints(
            each.points_enu_m, cv2.Rodrigues(cam_from_enu)[0], translation, k, np.array(camera.distortion)
        )
        np.testing.assert_allclose(each.pixels, pixels.reshape(-1, 2), atol=1e-6)


def test_only_what_is_in_the_image_is_seen(seen: list[Sighting]) -> None:
    pixels = np.concatenate([each.pixels for each in seen])
    margin = MARGIN_PX - 0.5
    assert np.all(pixels >= margin)
    assert np.all(pixels <= np.array([1279, 719]) - margin)
    assert all(each.pose.position_enu_m[2] > 1.0 for each in seen)


def test_nothing_is_seen_from_too_far_away(scenario: Scenario) -> None:
    near = look(scenario, replace(scenario.observing, max_range_m=45.0))
    assert near
    ranges = [np.linalg.norm(each.points_enu_m - each.pose.position_enu_m, axis=-1).max() for each in near]
    assert 40 < max(ranges) <= 45


def test_widths_are_the_rivers(scenario: Scenario, seen: list[Sighting]) -> None:
    names = {each.name for each in seen}
    assert {"river", "width-a", "width-b", "width-c"} <= names
    for index, station in enumerate(scenario.observing.stations_m):
        width = float(scenario.world.river.width_at(station))
        found = [each.value_m for each in seen if each.name == f"width-{'abc'[index]}"]
        assert found
        assert found == pytest.approx([width] * len(found))
    assert all(each.value_m is None for each in seen if each.kind == ProbeKind.POSITION)


def test_landmarks_are_where_the_world_has_them(scenario: Scenario, seen: list[Sighting]) -> None:
    landmarks = scenario.world.landmarks_enu_m()
    found = [each for each in seen if each.name in landmarks]
    assert found
    for each in found:
        np.testing.assert_array_equal(each.points_enu_m[0], landmarks[each.name])


def test_the_noise_has_its_std(scenario: Scenario) -> None:
    noisy = look(scenario, replace(scenario.observing, std_px=0.8))
    errors = np.concatenate([each.observed - each.pixels for each in noisy])
    assert errors.std() == pytest.approx(0.8, rel=0.06)
    again = look(scenario, replace(scenario.observing, std_px=0.8))
    for one, other in zip(noisy, again, strict=True):
        np.testing.assert_array_equal(one.observed, other.observed)


def test_lines_hold_what_the_service_reads(tmp_path: Path, seen: list[Sighting]) -> None:
    path = tmp_path / "observations.jsonl"
    write_lines(path, (each.observation_line() for each in seen))
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    for line, each in zip(lines, seen, strict=True):
        assert line == {
            "stamp_ns": str(each.stamp_ns),
            "name": each.name,
            "pixels": each.observed.tolist(),
            "std_px": 0.5,
        }
    truth = json.loads(seen[0].truth_line())
    assert truth["pixels"] == seen[0].pixels.tolist()
    assert truth["pose"]["height_agl_m"] == seen[0].pose.position_enu_m[2]
