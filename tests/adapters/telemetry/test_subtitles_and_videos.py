"""Cue times, FrameCnt and the drone's clock against the images of the video that subtitles are beside."""

import re
from datetime import datetime, timedelta
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from aerodft.adapters.images import VideoFilesSource
from aerodft.adapters.telemetry import CompositeDecoder, SubtitleLog
from aerodft.app.diagnose import diagnose
from aerodft.app.importing import import_flight
from aerodft.app.setup import draft_station
from aerodft.errors import InputError, UsageError
from aerodft.model import HeightTrack, RawBlock
from tests.adapters.telemetry.srt_writer import time_of

START = datetime(2024, 2, 28, 2, 13, 26, 240_000)  # noqa: DTZ001 - drones write no zone
CREATED = "2024-02-28T00:13:26Z"
RATES = ("30000/1001", "50", "60", "25", "24000/1001")


def write_video(
    path: Path, images: int, rate: str = "25", *, size: tuple[int, int] = (64, 48), created: str = CREATED
) -> None:
    with av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as container:
        container.metadata["creation_time"] = created
        stream = container.add_stream("mpeg4", rate=Fraction(rate))
        stream.width, stream.height = size
        frame = av.VideoFrame.from_ndarray(np.zeros((size[1], size[0], 3), dtype=np.uint8), format="bgr24")
        for k in range(images):
            frame.pts, frame.time_base = k, 1 / Fraction(rate)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def height_m(image: int) -> float:
    return 40 + 0.05 * image


def write_cues(  # noqa: PLR0913 - what may go wrong, each by its name
    path: Path,
    images: range,
    rate: str = "25",
    *,
    start: datetime = START,
    first_count: int = 1,
    without: frozenset[int] = frozenset(),
    clock_rate: float = 1.0,
    late_ms: int = 0,
    is_timed: bool = True,
) -> None:
    """Cues as a Matrice 30T writes them, of images by their numbers in the flight; cue times are truncated."""
    cues = []
    for k, image in enumerate(images):
        if k in without:
            continue
        ms = int(1000 * k / Fraction(rate))
        clock = start + timedelta(milliseconds=ms * clock_rate)
        when = f"{clock:%Y-%m-%d %H:%M:%S}.{clock.microsecond // 1000:03d}\n" if is_timed else ""
        cues.append(
            f"{len(cues) + 1}\n{time_of(ms + late_ms)} --> {time_of(ms + late_ms + 33)}\n"
            f"FrameCnt: {first_count + k}, DiffTime: 33ms\n{when}"
            f"[rel_alt: {height_m(image):.3f} abs_alt: 614.419] [gb_yaw: 10.0 gb_pitch: -60.0 gb_roll: 0.0]\n\n"
        )
    path.write_text("".join(cues))


def heights_at_images(log: SubtitleLog) -> list[float]:
    """Height above take-off at each image of a flight's own videos; NaN before the first and after the last cue."""
    decoder, rows = CompositeDecoder(), list[tuple[int, float]]()
    for block in log.events():
        assert isinstance(block, RawBlock)
        for track in decoder.decode(block):
            if isinstance(track, HeightTrack):
                rows += zip(track.arrival_ns.tolist(), track.value_m.tolist(), strict=True)
    stamps_ns = np.array([each.stamp_ns for each in VideoFilesSource(log.videos, decode=False).events()])
    at_ns = np.array([at for at, _ in rows])
    return np.interp(
        stamps_ns - at_ns[0], at_ns - at_ns[0], [height for _, height in rows], left=np.nan, right=np.nan
    ).tolist()


@pytest.mark.parametrize("rate", RATES)
def test_each_image_has_the_height_of_its_cue(tmp_path: Path, rate: str) -> None:
    write_video(tmp_path / "DJI_0001.MP4", 120, rate)
    write_cues(tmp_path / "DJI_0001.SRT", range(120), rate)
    log = SubtitleLog([tmp_path / "DJI_0001.MP4"])
    heights = heights_at_images(log)
    assert heights == pytest.approx([height_m(k) for k in range(120)], abs=0.004)  # a millisecond of 3 m/s
    assert not [each for each in log.warnings() if "local time" not in each]


def test_frame_count_that_starts_late_and_skips_is_no_number_of_images(tmp_path: Path) -> None:
    write_video(tmp_path / "clip.mp4", 120)
    write_cues(tmp_path / "clip.srt", range(120), first_count=218, without=frozenset({2, 3, 7, *range(20, 24), 60}))
    heights = heights_at_images(SubtitleLog([tmp_path / "clip.mp4"]))
    assert heights == pytest.approx([height_m(k) for k in range(120)], abs=0.004)


@pytest.mark.parametrize(
    ("images", "cues", "rate", "late_ms", "said"),
    [
        (60, 300, "25", 0, "another video, or of more than this one: got cues up to 12.0 s, and a video of 2.4 s"),
        (60, 60, "25", 346_382, "another video, or of more than this one"),
        (120, 60, "50", 0, "does not run as its subtitles do"),  # cues of another video, at twice the rate
        (120, 120, "100", 0, "does not run as its subtitles do: got cues up to 1.2 s, and a video of 4.8 s"),  # slowed
    ],
)
def test_subtitles_of_another_video_are_refused(
    tmp_path: Path, images: int, cues: int, rate: str, late_ms: int, said: str
) -> None:
    write_video(tmp_path / "clip.mp4", images)
    write_cues(tmp_path / "clip.srt", range(cues), rate, late_ms=late_ms)
    with pytest.raises(InputError, match=said):
        SubtitleLog([tmp_path / "clip.mp4"])
    (tmp_path / "clip.mp4").rename(tmp_path / "other.mp4")
    with pytest.raises(InputError, match=said):
        SubtitleLog([tmp_path / "clip.srt"]).check_video(tmp_path / "other.mp4")


def test_a_video_that_was_encoded_at_another_rate_keeps_its_subtitles(tmp_path: Path) -> None:
    write_video(tmp_path / "clip.mp4", 60, "25")
    write_cues(tmp_path / "clip.srt", range(120), "50")
    heights = heights_at_images(SubtitleLog([tmp_path / "clip.mp4"]))
    assert heights == pytest.approx([height_m(2 * k) for k in range(60)], abs=0.004)


def test_what_is_incomplete_or_contradicts_itself_is_said(tmp_path: Path) -> None:
    def said(images: int, cues: int, created: str = CREATED, **of_cues: float) -> str:
        write_video(tmp_path / "clip.mp4", images, created=created)
        write_cues(tmp_path / "clip.srt", range(cues), **of_cues)  # type: ignore[arg-type]
        return "\n".join(SubtitleLog([tmp_path / "clip.mp4"]).warnings())

    assert "cues end 9.6 s before the video" in said(300, 60)
    assert "cues begin 2.0 s after the video" in said(120, 60, late_ms=2000)
    assert "clock runs 0.25 times as fast as the video" in said(120, 120, clock_rate=0.25)
    assert "was made at 2023-05-01T00:00:00Z" in said(120, 120, created="2023-05-01T00:00:00Z")
    path = tmp_path / "clip.srt"
    whole = path.read_text()
    path.write_text(re.sub(r"02:13:(29|3\d)", r"02:23:\1", whole))
    steps = [each for each in SubtitleLog([path]).warnings() if "the drone's clock steps by +600.0 s at 2.8 s" in each]
    assert len(steps) == 1
    path.write_text(whole.replace("[gb_yaw: 10.0 gb_pitch: -60.0 gb_roll: 0.0]", "", 30))
    assert "no angles of the camera in 30 of 120 cues" in " ".join(SubtitleLog([path]).warnings())
    path.write_text(whole.replace("rel_alt: 40.", "rel_up: 40."))
    assert "no height in 20 of 120 cues" in " ".join(SubtitleLog([path]).warnings())
    write_cues(path, range(120), is_timed=False)
    path.write_text(path.read_text().replace("FrameCnt: 61,", "FrameCnt: 1,"))
    assert "FrameCnt starts again at 2.4 s" in " ".join(SubtitleLog([path]).warnings())


@pytest.mark.parametrize(
    ("first", "second", "restarts", "said"),
    [
        ("[focal_len: 24.00]", "[focal_len: 40.00]", True, "24 mm up to 2.4 s, then rel_alt with camera angles, 40 mm"),
        (
            "[rel_alt: 40.0 abs_alt: 600.0]",
            "[altitude: 600.0]",
            True,
            "rel_alt with camera angles up to 2.4 s, then alti",
        ),
        ("[gb_yaw: 10.0 gb_pitch: -60.0 gb_roll: 0.0]", "", True, "camera angles up to 2.4 s, then rel_alt"),
        ("[rel_alt: 40.0 abs_alt: 600.0]", "BAROMETER:40.0M", False, "camera angles up to 2.4 s, then"),
        ("[focal_len: 24.00]", "[focal_len: 40.00]", False, ""),  # a zoom
        ("[focal_len: 24.00]", "[focal_len: 24.00]", True, ""),  # two clips of one camera
    ],
)
def test_joined_clips_of_several_cameras_are_refused(
    tmp_path: Path, first: str, second: str, said: str, *, restarts: bool
) -> None:
    write_video(tmp_path / "clip.mp4", 120)
    cues = []
    for k in range(120):
        ms, number = int(1000 * k / 25), k % 60 + 1 if restarts else k + 1
        height = f"[rel_alt: {height_m(k):.3f} abs_alt: 614.419]"
        angles = "[gb_yaw: 10.0 gb_pitch: -60.0 gb_roll: 0.0]"
        own = second if k >= 60 else first
        texts = [each for each in (height, angles) if each[:7] not in {first[:7], second[:7]}]
        cues.append(
            f"{k + 1}\n{time_of(ms)} --> {time_of(ms + 33)}\nFrameCnt: {number}, DiffTime: 33ms\n"
            f"{' '.join([own, *texts])}\n\n"
        )
    (tmp_path / "clip.srt").write_text("".join(cues))
    if not said:
        assert SubtitleLog([tmp_path / "clip.mp4"]).counts.frames == 120
        return
    with pytest.raises(InputError, match="clips of several cameras were joined") as caught:
        SubtitleLog([tmp_path / "clip.mp4"])
    assert said in str(caught.value)


def test_parts_of_a_cut_video_share_a_zone_and_a_size(tmp_path: Path) -> None:
    first, second = tmp_path / "DJI_0001.MP4", tmp_path / "DJI_0002.MP4"
    write_video(first, 100, "30000/1001")
    write_cues(first.with_suffix(".SRT"), range(100), "30000/1001")
    write_video(second, 50, "30000/1001", created="1904-01-01T00:00:00Z")  # a part whose container has no time
    goes_on = START + timedelta(seconds=100 * 1001 / 30000, milliseconds=72)
    write_cues(second.with_suffix(".SRT"), range(100, 150), "30000/1001", start=goes_on)
    for order in ([first, second], [second, first]):
        log = SubtitleLog(order)
        assert heights_at_images(log) == pytest.approx([height_m(k) for k in range(150)], abs=0.004)
        assert " ".join(log.warnings()).count("UTC+2 h") == 2
    write_cues(second.with_suffix(".SRT"), range(100, 150), "30000/1001", start=goes_on + timedelta(minutes=10))
    assert "begins 600.1 s after the end of" in " ".join(SubtitleLog([first, second]).warnings())
    write_video(second, 50, "30000/1001", size=(96, 64))
    with pytest.raises(InputError, match=r"DJI_0002.MP4: not a part of the same video: got 64 x 48 px and 96 x 64 px"):
        SubtitleLog([first, second])


def test_intervals_cover_the_moment_within_a_cue(tmp_path: Path) -> None:
    path = tmp_path / "clip.srt"
    write_cues(path, range(60))
    assert SubtitleLog([path]).time_std_s == pytest.approx(0.1 / 12**0.5)  # positions are renewed ten times a second
    write_cues(path, range(10), "1")
    assert SubtitleLog([path]).time_std_s == pytest.approx(1 / 12**0.5)


def test_angles_are_interpolated_between_cues_a_second_apart(tmp_path: Path) -> None:
    path = tmp_path / "clip.srt"
    write_cues(path, range(10), "1000/1001")  # 1.001 s apart
    poses = diagnose(path).to_dict()["poses"]
    assert poses["ok_s"] == pytest.approx(poses["seconds"], abs=0.2)


def test_a_station_for_a_cut_video_measures_all_its_parts(tmp_path: Path) -> None:
    first, second = tmp_path / "DJI_0001.MP4", tmp_path / "DJI_0002.MP4"
    for path, images, start in ((first, range(30), START), (second, range(30, 50), START + timedelta(seconds=1.25))):
        write_video(path, len(images), "25")
        write_cues(path.with_suffix(".SRT"), images, start=start)
    draft = draft_station([second, first], tmp_path / "mine", home_above_plane_m=1.5)
    assert (draft.log, draft.later) == (first, (second,))
    recording = tmp_path / "recording"
    result = import_flight([first, second], station=draft.station, output=recording)
    assert result.statistics.poses["ok"] == 50
    write_cues(second.with_suffix(".SRT"), range(80))  # of another video
    with pytest.raises(InputError, match="another video"):
        draft_station([second], tmp_path / "other")


def test_a_station_for_subtitles_alone_has_their_video_or_states_what_they_lack(tmp_path: Path) -> None:
    path = tmp_path / "clip.srt"
    write_cues(path, range(30))
    assert "rate_hz" in draft_station([path], tmp_path / "without").station.read_text()
    write_video(tmp_path / "clip.mp4", 30)
    assert 'video = "../clip.mp4"' in draft_station([path], tmp_path / "with").station.read_text()
    path.write_text(path.read_text().replace("rel_alt", "rel_up"))
    draft = draft_station([path], tmp_path / "low")
    assert draft.to_do[0].startswith("State the camera's height above the water")


def test_videos_without_subtitles_are_no_parts(tmp_path: Path) -> None:
    for name in ("a.mp4", "b.mp4"):
        write_video(tmp_path / name, 3)
    with pytest.raises(UsageError, match="several videos without subtitles"):
        draft_station([tmp_path / "a.mp4", tmp_path / "b.mp4"], tmp_path / "mine")
    assert draft_station([tmp_path / "a.mp4"], tmp_path / "one").view == tmp_path / "a.mp4"
