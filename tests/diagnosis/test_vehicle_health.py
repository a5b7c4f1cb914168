"""What a whole log says of a camera, against its file."""

import math

import numpy as np
import pytest

from aerodft.diagnosis.vehicle_health import VehicleHealth
from aerodft.model import NO_BOOT_TIME, Camera, CameraTrack, ZoomSource
from aerodft.service import TelemetrySettings, ZoomSettings


def _track(
    source: ZoomSource, *, hfov_deg: float = math.nan, level: float = math.nan, camera: int = 1, stream: int = 0
) -> CameraTrack:
    return CameraTrack(
        arrival_ns=np.array([0]),
        boot_ns=np.array([NO_BOOT_TIME]),
        source=source,
        device=np.array([camera]),
        stream=np.array([stream]),
        hfov_rad=np.radians([hfov_deg]),
        level=np.array([level]),
        size_px=np.zeros((1, 2), dtype=np.int64),
    )


def _camera(hfov_deg: float) -> Camera:
    return Camera.from_fov(name="c", width_px=1920, height_px=1080, hfov_rad=math.radians(hfov_deg), vfov_rad=0.66)


@pytest.mark.parametrize(
    ("source", "off_deg", "is_said"),
    [
        (ZoomSource.CAMERA_FOV_STATUS, 0.45, False),
        (ZoomSource.CAMERA_FOV_STATUS, 0.55, True),
        (ZoomSource.VIDEO_STREAM_INFORMATION, 0.55, False),  # its whole degrees are 0.29 deg off by themselves
        (ZoomSource.VIDEO_STREAM_INFORMATION, 0.62, True),
    ],
)
def test_a_field_of_view_contradicts_the_file_by_more_than_its_std(source, off_deg, is_said) -> None:
    survey = VehicleHealth()
    survey.add(_track(source, hfov_deg=63.0))
    assert any("says hfov 63.0 deg" in each for each in survey.sentences(_camera(63.0 + off_deg))) is is_said


@pytest.mark.parametrize(
    ("zoom", "is_said"),
    [
        (ZoomSettings(), True),
        (ZoomSettings(reported_hfov_rad=math.radians(62.0)), False),
        (ZoomSettings(order=(ZoomSource.CAMERA_SETTINGS,)), False),
    ],
)
def test_a_station_states_what_the_vehicle_reports_of_its_camera(zoom, is_said) -> None:
    survey = VehicleHealth()
    survey.add(_track(ZoomSource.CAMERA_FOV_STATUS, hfov_deg=62.0))
    found = survey.sentences(_camera(70.0), TelemetrySettings(zoom=zoom))
    assert any("says hfov 62.0 deg" in each for each in found) is is_said


@pytest.mark.parametrize(
    ("level", "zoom", "is_said"),
    [
        (0.0, ZoomSettings(), False),
        (0.5, ZoomSettings(), True),  # whether it moves or not: no image of it has an answer
        (0.5, ZoomSettings(level=0.5), False),
        (0.5, ZoomSettings(curve=((0.0, 1.0), (1.0, 6.0))), False),
    ],
)
def test_a_zoom_of_unknown_effect_is_said(level, zoom, is_said) -> None:
    survey = VehicleHealth()
    survey.add(_track(ZoomSource.CAMERA_SETTINGS, level=level))
    found = survey.sentences(None, TelemetrySettings(zoom=zoom))
    assert any("set telemetry.zoom.curve" in each for each in found) is is_said


@pytest.mark.parametrize(
    ("zoom", "said", "unsaid"),
    [
        (
            ZoomSettings(),
            ("more than one camera reports its view (1, 100)", "camera 100 has several streams (1, 2)"),
            "not heard",
        ),
        (ZoomSettings(camera=1), ("CAMERA_FOV_STATUS of camera 1 says hfov 62.0 deg",), "camera 100"),
        (
            ZoomSettings(camera=100),
            ("VIDEO_STREAM_INFORMATION of camera 100, stream 2 says hfov 12.0 deg",),
            "camera 1 ",
        ),
        (ZoomSettings(camera=100, stream=1), (), "hfov"),
        (ZoomSettings(camera=7), ("telemetry.zoom.camera = 7 is not heard, cameras 1, 100 are",), "says hfov"),
    ],
)
def test_cameras_and_their_streams_are_named_and_told_apart(zoom, said, unsaid) -> None:
    survey = VehicleHealth()
    survey.add(_track(ZoomSource.CAMERA_FOV_STATUS, hfov_deg=62.0))
    for stream, hfov_deg in ((1, 70.0), (2, 12.0)):
        survey.add(_track(ZoomSource.VIDEO_STREAM_INFORMATION, hfov_deg=hfov_deg, camera=100, stream=stream))
    found = survey.sentences(_camera(70.0), TelemetrySettings(zoom=zoom))
    assert all(any(words in each for each in found) for words in said)
    assert not any(unsaid in each for each in found)
    assert not any("moves between" in each for each in found)
    assert [each["camera"] for each in survey.document()["cameras"]] == [1, 100, 100]
