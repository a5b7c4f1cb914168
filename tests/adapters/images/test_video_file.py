import logging
import threading
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from aerodft.adapters.images import VideoFileSource, video_info
from aerodft.errors import InputError

MakeVideo = Callable[..., Path]
START_NS = 1_795_221_278_868_833_123
GEUL = Path(__file__).parents[3].parent / "shared" / "data" / "landmarks" / "geul" / "dk_control.mp4"
UNEVEN_MS = [0, 33, 67, 100, 140, 250, 251, 300, 333, 367, 400, 433]


def stamps_of(path: Path, *, decode: bool = True) -> list[int]:
    return [image.stamp_ns - START_NS for image in VideoFileSource(path, start_ns=START_NS, decode=decode).events()]


@pytest.mark.parametrize("decode", [True, False])
@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "a.mov", "a.ts", "a.avi"])
def test_stamps_are_the_containers_own(tmp_path: Path, make_video: MakeVideo, name: str, decode: bool) -> None:  # noqa: FBT001
    even = [40 * index for index in range(12)]
    wanted = even if name.endswith("avi") else UNEVEN_MS  # AVI knows no uneven stamps
    base = Fraction(1, 25) if name.endswith("avi") else Fraction(1, 1000)
    codec = "mpeg4" if name.endswith("avi") else "libx264"
    path = make_video(tmp_path / name, [round(ms / 1000 / base) for ms in wanted], base=base, codec=codec)
    got = stamps_of(path, decode=decode)
    assert len(got) == len(wanted)
    tick_ns = 1e9 / 90_000 if name.endswith("ts") else 1  # a transport stream counts 90 kHz
    np.testing.assert_allclose(got, np.array(wanted) * 1e6, atol=tick_ns)


def test_images_that_are_stored_out_of_order_come_in_order(
    tmp_path: Path, make_video: MakeVideo, grey: Callable[[int], int]
) -> None:
    path = make_video(tmp_path / "b.mp4", [40 * i for i in range(16)], options={"bf": "3", "b_strategy": "0"})
    with av.open(str(path)) as container:
        stored = [packet.pts for packet in container.demux(video=0) if packet.pts is not None]
    assert stored != sorted(stored)
    images = list(VideoFileSource(path, start_ns=START_NS).events())
    assert [image.stamp_ns - START_NS for image in images] == [40_000_000 * i for i in range(16)]
    assert stamps_of(path, decode=False) == [40_000_000 * i for i in range(16)]
    assert [image.index for image in images] == list(range(16))
    for image in images:  # asked for only now, after the file was closed
        assert image.pixels is not None
        pixels = image.pixels()
        assert pixels.shape == (image.height_px, image.width_px, 3) == (48, 64, 3)
        np.testing.assert_allclose(pixels, grey(image.index), atol=5)


def test_a_third_of_a_second_stays_exact_for_hours(tmp_path: Path, make_video: MakeVideo) -> None:
    base = Fraction(1001, 30000)
    path = make_video(tmp_path / "n.mkv", [0, 1, 431_568], base=base)  # four hours of 29.97 Hz; Matroska counts 1 ms
    assert stamps_of(path) == [0, 33_000_000, 14_399_986_000_000]
    path = make_video(tmp_path / "n.mp4", [0, 1, 107_892], base=base)
    assert stamps_of(path) == [round(Fraction(1001 * n * 10**9, 30000)) for n in (0, 1, 107_892)]


def test_a_time_line_that_starts_elsewhere_starts_at_the_first_image(tmp_path: Path, make_video: MakeVideo) -> None:
    path = make_video(tmp_path / "a.ts", [5000 + 40 * i for i in range(30)])
    with av.open(str(path)) as container:
        assert container.streams.video[0].start_time != 0
    assert stamps_of(path) == [40_000_000 * i for i in range(30)]


def test_the_span_is_that_of_the_stamps(tmp_path: Path, make_video: MakeVideo) -> None:
    path = make_video(tmp_path / "a.mp4", [0, 40])
    source = VideoFileSource(path, start_ns=START_NS)
    images = list(source.events())
    assert source.span_ns is not None
    assert source.span_ns[0] == images[0].stamp_ns
    assert source.span_ns[1] > images[1].stamp_ns
    assert [image.stamp_ns for image in images] == [START_NS, START_NS + 40_000_000]
    assert [image.arrival_ns for image in images] == [image.stamp_ns for image in images]


def test_the_start_comes_from_the_container(tmp_path: Path, make_video: MakeVideo) -> None:
    dated = make_video(tmp_path / "a.mp4", [0, 40], metadata={"creation_time": "2026-11-21T01:57:26.000000Z"})
    assert VideoFileSource(dated).start_ns == 1_795_226_246_000_000_000
    apple = make_video(
        tmp_path / "b.mov",
        [0, 40],
        metadata={
            "creation_time": "2026-11-21T01:57:30.000000Z",
            "com.apple.quicktime.creationdate": "2026-11-21T02:57:26+0100",
        },
        muxer={"movflags": "use_metadata_tags"},
    )
    assert VideoFileSource(apple).start_ns == 1_795_226_246_000_000_000


@pytest.mark.parametrize("metadata", [{}, {"creation_time": "1970-01-01T00:00:00.000000Z"}])
def test_no_start_anywhere_is_refused(tmp_path: Path, make_video: MakeVideo, metadata: dict[str, str]) -> None:
    path = make_video(tmp_path / "a.mp4", [0, 40], metadata=metadata)
    with pytest.raises(InputError, match=r"a\.mp4: does not say when it was recorded: .*; pass `video_start_ns`"):
        VideoFileSource(path)


def test_pixels_are_what_an_outside_reader_sees() -> None:
    if not GEUL.exists():
        pytest.skip("needs ../shared/data/landmarks/geul/dk_control.mp4")
    info = video_info(GEUL)
    assert (info.width_px, info.height_px, info.images) == (1920, 1080, 10)
    capture = cv2.VideoCapture(str(GEUL))
    images = list(VideoFileSource(GEUL, start_ns=START_NS).events())
    for image in images:
        read, wanted = capture.read()
        assert read
        assert image.stamp_ns - START_NS == pytest.approx(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6, abs=1e3)
        assert image.pixels is not None
        difference = np.abs(image.pixels().astype(int) - np.asarray(wanted, dtype=int))
        assert np.percentile(difference, 99) <= 3  # two colour converters round differently
    capture.release()


def test_pixels_are_read_only_and_safe_to_ask_for_in_parallel(tmp_path: Path, make_video: MakeVideo) -> None:
    image = next(iter(VideoFileSource(make_video(tmp_path / "a.mp4", [0, 40]), start_ns=0).events()))
    assert image.pixels is not None
    seen: list[int] = []
    ask = image.pixels
    threads = [threading.Thread(target=lambda: seen.append(id(ask()))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(seen)) == 1
    with pytest.raises(ValueError, match="read-only"):
        image.pixels()[0, 0, 0] = 1


def test_a_cut_file_gives_images_up_to_the_cut(
    tmp_path: Path, make_video: MakeVideo, caplog: pytest.LogCaptureFixture
) -> None:
    whole = make_video(
        tmp_path / "w.mp4", [40 * i for i in range(50)], options={"g": "10"}, muxer={"movflags": "faststart"}
    )
    cut = tmp_path / "cut.mp4"
    data = whole.read_bytes()
    cut.write_bytes(data[: len(data) - (len(data) - data.index(b"mdat")) // 2])
    with caplog.at_level(logging.WARNING):
        got = stamps_of(cut)
    assert 5 <= len(got) < 50
    assert got == [40_000_000 * i for i in range(len(got))]
    assert f"{cut}: ends early, after" in caplog.text


def test_a_file_that_was_cut_before_its_index_says_so(tmp_path: Path, make_video: MakeVideo) -> None:
    data = make_video(tmp_path / "w.mp4", [40 * i for i in range(50)]).read_bytes()
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(data[: data.index(b"moov") - 4])
    with pytest.raises(InputError, match=r"cut\.mp4: not a readable video: got an MP4 .*; it is cut off before its in"):
        VideoFileSource(cut, start_ns=0)


def test_damage_in_the_middle_costs_some_images_only(
    tmp_path: Path, make_video: MakeVideo, caplog: pytest.LogCaptureFixture
) -> None:
    path = make_video(tmp_path / "d.mp4", [40 * i for i in range(60)], options={"g": "5", "bf": "0"})
    data = bytearray(path.read_bytes())
    start, end = data.index(b"mdat"), data.index(b"moov")
    middle = (start + end) // 2
    data[middle : middle + 60] = bytes(60)
    path.write_bytes(data)
    with caplog.at_level(logging.WARNING):
        got = stamps_of(path)
    assert 40 <= len(got) < 60
    assert got == sorted(set(got))
    assert got[-1] >= 50 * 40_000_000
    assert "damaged" in caplog.text


def test_a_matroska_file_that_breaks_off_says_so(
    tmp_path: Path, make_video: MakeVideo, caplog: pytest.LogCaptureFixture
) -> None:
    path = make_video(tmp_path / "d.mkv", [40 * i for i in range(100)], options={"g": "5"})
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2] + bytes(len(data) // 2))
    with caplog.at_level(logging.WARNING):
        assert stamps_of(path)
    assert f"{path}: ends early, after" in caplog.text


def test_a_file_without_stamps_continues_at_its_rate(tmp_path: Path, make_video: MakeVideo) -> None:
    path = make_video(tmp_path / "raw.h264", [40 * i for i in range(5)], options={"bf": "0"})
    got = stamps_of(path)
    steps = np.diff(got)
    assert len(got) == 5
    assert (steps == steps[0]).all()
    assert steps[0] > 0


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "x.mp4: not a readable video: got an empty file, expected a video file"),
        (b"hello there\n" * 50, "x.mp4: not a readable video: got text, expected a video file"),
        (b"\xa3\x95\x80\x80" * 50, "x.mp4: not a readable video: got an ArduPilot .bin log, expected a video file"),
        (bytes(range(256)) * 9, "x.mp4: not a readable video: got unknown binary data, expected a video file"),
    ],
)
def test_what_is_no_video_is_named(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "x.mp4"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        VideoFileSource(path, start_ns=0)
    assert sentence in str(caught.value)


def test_a_still_a_folder_or_nothing_is_no_video(tmp_path: Path) -> None:
    still = tmp_path / "x.mp4"
    encoded, data = cv2.imencode(".jpg", np.zeros((8, 8, 3), dtype=np.uint8))
    assert encoded
    still.write_bytes(data.tobytes())
    with pytest.raises(InputError, match="got a JPEG image, expected a video file"):
        VideoFileSource(still, start_ns=0)
    with pytest.raises(InputError, match="no video file: got a folder"):
        VideoFileSource(tmp_path, start_ns=0)
    with pytest.raises(InputError, match="no video file: got nothing there"):
        VideoFileSource(tmp_path / "absent.mp4", start_ns=0)


def test_leaving_early_closes_the_file(tmp_path: Path, make_video: MakeVideo) -> None:
    events = VideoFileSource(make_video(tmp_path / "a.mp4", [40 * i for i in range(20)]), start_ns=0).events()
    assert next(iter(events)).index == 0
    events.close()  # type: ignore[attr-defined]
    assert next(iter(events), None) is None


def test_a_damaged_image_does_not_renumber_the_others(tmp_path: Path) -> None:
    """What was observed in image 40 belongs to image 40, whether image 20 can be decoded or not."""
    noise = np.random.default_rng(1)
    path = tmp_path / "a.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=20)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(60):
            pixels = noise.integers(0, 255, (48, 64, 3), dtype=np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="bgr24")))
        container.mux(stream.encode())
    data = bytearray(path.read_bytes())
    middle = len(data) // 3
    data[middle : middle + 6000] = noise.bytes(6000)
    path.write_bytes(data)

    def stamps(*, decode: bool) -> dict[int, int]:
        source = VideoFileSource(path, start_ns=START_NS, decode=decode)
        return {image.index: image.stamp_ns for image in source.events()}

    known, decoded = stamps(decode=False), stamps(decode=True)
    assert 20 < len(decoded) < len(known)
    assert decoded == {index: known[index] for index in decoded}
