"""Images of a zoomed camera against a camera that has that focal length; and what contradicts the camera file."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.model import Camera, Probe, ProbeKind, Status, ZoomSource
from aerodft.service import ZoomSettings

MS = 1_000_000
HFOV_RAD = 1.1
CURVE = ((0.0, 1.0), (1.0, 6.0))
WIDTH = Probe(name="w", kind=ProbeKind.DISTANCE, pixels=((600.0, 500.0), (1300.0, 520.0)), std_px=0.5)


def _settings_message(boot_ms, percent):
    return dialect.MAVLink_camera_settings_message(boot_ms, 0, zoomLevel=percent)


def _fov_message(boot_ms, hfov_deg):
    return dialect.MAVLink_camera_fov_status_message(boot_ms, 0, 0, 0, 0, 0, 0, (1, 0, 0, 0), hfov_deg, 30.0)


def _video_message(_boot_ms, hfov_deg, width=1920, height=1080):
    return dialect.MAVLink_video_stream_information_message(
        1, 1, 0, 1, 30.0, width, height, 0, 0, round(hfov_deg), b"front", b"rtsp://camera"
    )


@pytest.fixture
def fly(bench):
    """Measures ``WIDTH`` in an image every 150 ms of a flight, with reports in between.

    Those are ``(boot_ms, message)`` of the autopilot, or ``(boot_ms, component, message)``.
    """

    def measured(reports=(), zoom=None, camera=None, seconds=6.0):
        sent = [each if len(each) > 2 else (each[0], 1, each[1]) for each in reports]
        extra = [
            (bench.host0_ns + ms * MS + 5 * MS, bytes(message.pack(dialect.MAVLink(None, 1, component))))
            for ms, component, message in sent
        ]
        telemetry = replace(bench.settings.telemetry, zoom=zoom or ZoomSettings())
        made = bench.pipeline(telemetry=telemetry, camera=camera or bench.settings.camera, probes=(WIDTH,))
        images = [bench.image(k, 500 + 150 * k) for k in range(int((seconds - 1) / 0.15))]
        outputs = bench.run_events(*bench.blocks(sorted([*bench.flight(seconds), *extra])), *images, made=made)
        return bench.measured(outputs, "w"), outputs

    return measured


def _boot_ms(bench, measurement):
    return (measurement.stamp_ns - bench.utc0_ns) // MS


def test_a_zoomed_image_is_measured_with_the_zoomed_focal_length(fly, bench):
    steps = [(ms, 0.0 if ms < 3000 else 40.0) for ms in range(0, 6000, 200)]
    zoomed, outputs = fly([(ms, _settings_message(ms, p)) for ms, p in steps], ZoomSettings(curve=CURVE))
    own = bench.settings.camera
    tele, _ = fly(camera=replace(own, fx_px=3.0 * own.fx_px, fy_px=3.0 * own.fy_px))
    wide, _ = fly()
    for found, narrow, plain in zip(zoomed, tele, wide, strict=True):
        ms = _boot_ms(bench, found)
        assert found.status is Status.OK
        if ms < 2700:
            assert found.value == pytest.approx(plain.value, rel=1e-9)
        elif ms > 3250:
            assert found.value == pytest.approx(narrow.value, rel=1e-6)
            assert found.std > narrow.std  # by what a zoom may be off
    poses = [each for each in bench.poses(outputs) if each.zoom is not None]
    assert {each.zoom.source for each in poses} == {ZoomSource.CAMERA_SETTINGS}
    assert max(each.zoom.magnification for each in poses) == pytest.approx(3.0, rel=1e-6)


def test_a_change_between_two_reports_is_as_uncertain_as_it_says(fly, bench):
    """Monte-Carlo: the focal length doubles at any time between two reports, 800 ms apart; errors fit their stds."""
    reports = [(ms, _settings_message(ms, 0.0 if ms < 3000 else 100.0)) for ms in range(200, 6000, 800)]
    _, outputs = fly(reports, ZoomSettings(curve=((0.0, 1.0), (1.0, 2.0)), std_per_doubling=0.0))
    between = [each for each in bench.poses(outputs) if each.zoom is not None and 1.0 < each.zoom.magnification < 2.0]
    assert len(between) > 4
    changed_ms = np.random.default_rng(5).uniform(2600, 3400, 20_000)
    for each in between:
        truth = np.where(changed_ms < _boot_ms(bench, each), 2.0, 1.0)
        z = (each.zoom.magnification - truth) / each.zoom.std
        assert abs(z.mean()) < 0.05
        assert np.mean(z**2) == pytest.approx(1.0, abs=0.08)


def test_a_field_of_view_that_moves_is_followed(fly, bench):
    """Closed form: focal length goes with the cotangent of half the field of view."""
    half = math.degrees(HFOV_RAD) / 2
    narrow_deg = 2 * math.degrees(math.atan(math.tan(math.radians(half)) / 2))
    reports = [
        (ms, _fov_message(ms, math.degrees(HFOV_RAD) if ms < 2000 else narrow_deg)) for ms in range(0, 6000, 200)
    ]
    _, outputs = fly(reports)
    late = [each for each in bench.poses(outputs) if (each.stamp_ns - bench.utc0_ns) // MS > 2500]
    np.testing.assert_allclose([each.zoom.magnification for each in late], 2.0, rtol=1e-6)
    # 2 % for the doubling, and half a degree of the field of view: df / f = dh / sin h
    share = math.hypot(0.02, math.radians(0.5) / math.sin(math.radians(narrow_deg)))
    np.testing.assert_allclose([each.zoom.std / each.zoom.magnification for each in late], share, rtol=1e-5)


def test_a_typed_in_field_of_view_is_held_against_the_camera_file(fly, bench):
    other, outputs = fly([(ms, _fov_message(ms, 80.0)) for ms in range(0, 6000, 200)])
    plain, _ = fly()
    assert [each.value for each in other] == [each.value for each in plain]
    said = "CAMERA_FOV_STATUS says hfov 80.0 deg, the camera file 63.0 deg (std of the two 0.5 deg): the file is taken"
    assert all(said in each.reasons for each in other[1:])
    assert all(each.zoom is None for each in bench.poses(outputs))


@pytest.mark.parametrize(("off_deg", "is_said"), [(0.4, False), (0.6, True), (-0.6, True)])
def test_what_contradicts_is_more_than_its_std_off(fly, off_deg, is_said):
    found, _ = fly([(ms, _fov_message(ms, math.degrees(HFOV_RAD) + off_deg)) for ms in range(0, 6000, 500)])
    assert any("CAMERA_FOV_STATUS" in reason for reason in found[-1].reasons) is is_said


def test_another_resolution_is_said(fly):
    found, _ = fly([(ms, _video_message(ms, 63.0, 1280, 720)) for ms in range(0, 6000, 500)])
    assert "VIDEO_STREAM_INFORMATION says 1280 x 720 px, the camera file 1920 x 1080 px" in found[-1].reasons


def test_a_zoom_of_unknown_effect_has_no_answer(fly, bench):
    found, _ = fly([(ms, _settings_message(ms, 0.0 if ms < 3000 else 50.0)) for ms in range(0, 6000, 500)])
    by_time = {_boot_ms(bench, each): each for each in found}
    assert all(each.status is Status.OK for ms, each in by_time.items() if ms < 2500)
    late = [each for ms, each in by_time.items() if ms > 3100]
    assert {each.status for each in late} == {Status.CAMERA_ZOOMED}
    assert all(each.value is None and "zoom 50.0 %" in each.reasons[0] for each in late)


def _every(*messages, after_ms=0):
    """``(boot_ms, component, message)`` of the makers of messages ``(component, maker)``, twice a second."""
    return [(ms, *each) for ms in range(after_ms, 6000, 500) for each in ((c, make(ms)) for c, make in messages)]


def _attached(number, percent):
    return lambda ms: dialect.MAVLink_camera_settings_message(ms, 0, percent, camera_device_id=number)


@pytest.mark.parametrize(
    ("first", "second", "numbers"),
    [
        ((100, _attached(0, 0.0)), (101, _attached(0, 70.0)), (100, 101)),
        ((1, _attached(0, 0.0)), (1, _attached(2, 70.0)), (1, 2)),
    ],
)
def test_of_two_cameras_the_one_asked_for_counts_and_without_a_choice_none(fly, bench, first, second, numbers):
    reports = _every(first, second)
    asked = [fly(reports, ZoomSettings(camera=number, curve=CURVE)) for number in numbers]
    wide, _ = fly()
    assert [each.value for each in asked[0][0]] == [each.value for each in wide]
    np.testing.assert_allclose([each.zoom.magnification for each in bench.poses(asked[1][1])], 4.5, rtol=1e-9)
    neither, _ = fly(reports, ZoomSettings(curve=CURVE))
    said = f"several cameras report ({numbers[0]}, {numbers[1]}), and not the same zoom: "
    said += "set telemetry.zoom.camera to one of them"
    assert {(each.status, each.reasons[0]) for each in neither} == {(Status.CAMERA_ZOOMED, said)}
    assert f"camera {numbers[1]}: CAMERA_SETTINGS says zoom x 4.50" in neither[-1].reasons


def test_cameras_that_are_not_zoomed_need_no_choice(fly):
    found, _ = fly(_every((100, _attached(0, 0.0)), (1, lambda ms: _fov_message(ms, 80.0))))
    plain, _ = fly()
    assert [each.value for each in found] == [each.value for each in plain]
    assert any(each.startswith("camera 1: CAMERA_FOV_STATUS says hfov 80.0 deg") for each in found[-1].reasons)


def test_reports_of_another_camera_leave_no_trace(fly, bench):
    narrow = _every((101, lambda ms: _fov_message(ms, 63.0 if ms < 2000 else 40.0)))
    other = _every((100, _attached(0, 30.0)), (100, lambda ms: _video_message(ms, 20.0 + ms / 1000, 640, 480)))
    zoom = ZoomSettings(camera=101, curve=CURVE)
    alone, mixed = fly(narrow, zoom), fly(sorted([*narrow, *other], key=lambda each: each[0]), zoom)
    assert [bench.encoded([each]) for each in alone[1]] == [bench.encoded([each]) for each in mixed[1]]


def test_of_two_streams_of_a_camera_one_counts(fly, bench):
    def stream(number, hfov_deg):
        return lambda ms: dialect.MAVLink_video_stream_information_message(
            number, 2, 0, 1, 30.0, 1920, 1080, 0, 0, hfov_deg(ms), b"", b""
        )

    reports = _every((100, stream(1, lambda _: 63)), (100, stream(2, lambda ms: 63 if ms < 2000 else 20)))
    first, second = (fly(reports, ZoomSettings(stream=number)) for number in (None, 2))
    assert all(each.zoom is None and each.status is Status.OK for each in bench.poses(first[1]))
    assert bench.poses(second[1])[-1].zoom.magnification == pytest.approx(
        math.tan(HFOV_RAD / 2) / math.tan(math.radians(10)), rel=1e-6
    )


def test_a_report_now_and_then_holds_until_the_next(fly, bench):
    """What is said once, on a change, holds for as long as nothing else is said, without waiting for more."""
    found, _ = fly([(300, _settings_message(300, 20.0))], ZoomSettings(curve=CURVE))
    own = bench.settings.camera
    twice, _ = fly(camera=replace(own, fx_px=2 * own.fx_px, fy_px=2 * own.fy_px))
    np.testing.assert_allclose([each.value for each in found], [each.value for each in twice], rtol=1e-6)


def test_answers_do_not_depend_on_how_frames_are_cut(bench):
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    reports = [(ms, _settings_message(ms, min(ms / 60, 100.0))) for ms in range(0, 6000, 270)]
    extra = [(bench.host0_ns + ms * MS + 5 * MS, bytes(each.pack(mav))) for ms, each in reports]
    frames = sorted([*bench.flight(6.0), *extra])
    images = [bench.image(k, 500 + 150 * k) for k in range(30)]
    telemetry = replace(bench.settings.telemetry, zoom=ZoomSettings(curve=CURVE))

    def encoded(cuts):
        made = bench.pipeline(telemetry=telemetry, probes=(WIDTH,))
        return bench.encoded(bench.run_events(*bench.blocks(frames, cuts), *images, made=made))

    whole = encoded(None)
    assert any(b'"source":"CAMERA_SETTINGS"' in each for each in whole)
    assert encoded([10, 50, 51, 200]) == whole


def test_a_zoomed_camera_scales_its_covariance():
    """Linear propagation of f' = m f, m uncertain and independent of f, against the definition."""
    camera = Camera.from_fov(name="c", width_px=1920, height_px=1080, hfov_rad=1.1, vfov_rad=0.66)
    own = np.diag([4.0, 5.0, 1.0, 1.0])
    own[0, 1] = own[1, 0] = 3.0
    zoomed = replace(camera, covariance=tuple(map(tuple, own.tolist()))).zoomed(2.5, 0.02)
    by = np.diag([2.5, 2.5, 1.0, 1.0])
    moved = np.array([camera.fx_px, camera.fy_px, 0.0, 0.0])
    np.testing.assert_allclose(zoomed.covariance, by @ own @ by.T + 0.02**2 * np.outer(moved, moved), rtol=1e-12)
    assert zoomed.hfov_rad == pytest.approx(2 * math.atan(math.tan(0.55) / 2.5))
