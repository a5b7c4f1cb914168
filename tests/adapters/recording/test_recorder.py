"""Recordings: what the stock readers find in them, what comes back, and what a slow or full disk costs."""

import logging
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import numpy as np
import orjson
import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from aerodft.adapters.recording.write import McapRecorder, RecorderSettings
from aerodft.adapters.wire.events import decode_image
from aerodft.adapters.wire.measurement import split_measurements
from aerodft.adapters.wire.pose import decode_pose
from aerodft.adapters.wire.schemas import SCHEMAS
from aerodft.errors import InputError, NoAnswerError
from aerodft.geometry import camera_attitude
from aerodft.model import (
    Camera,
    Image,
    LensModel,
    Measurement,
    Observation,
    Pose,
    PoseSample,
    ProbeKind,
    ProjectionModel,
    Status,
    WireProtocol,
)
from aerodft.service import Batches, MergedFeed, block_of
from replay.recordings import Recording, RecordingSource
from tests.batches import one_tick, take
from tests.nights import at_night
from tests.payloads import decode_observation, decode_status

START_NS = 1_795_221_278_000_000_000
TICK_NS = 50_000_000
CAMERA = Camera.from_fov(name="cam", width_px=64, height_px=48, hfov_rad=1.0, vfov_rad=0.8)


def pixels_of(index: int) -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
    return np.full((48, 64, 3), (index * 20) % 256, dtype=np.uint8)


def a_batch(step: int, *, pixels: bool = True) -> Batches:
    now_ns = START_NS + step * TICK_NS
    frames = [
        block_of(WireProtocol.MAVLINK, "udp:1", [now_ns - 30, now_ns - 10], [b"one%d" % step, b"three"]),
        block_of(WireProtocol.MAVLINK, "udp:2", [now_ns - 20], [b"two"]),
    ]
    if step % 4:
        return one_tick(now_ns, frames)
    taken_ns = now_ns - 15
    image = Image(
        index=step,
        stamp_ns=taken_ns - 7,
        arrival_ns=taken_ns,
        width_px=64,
        height_px=48,
        pixels=(lambda: pixels_of(step)) if pixels else None,
    )
    seen = Observation(name="w/a", stamp_ns=taken_ns, arrival_ns=now_ns - 5, pixels=((1.5, 2.0),))
    return one_tick(now_ns, [*frames, image, seen])


def outputs_of(batch: Batches) -> tuple[PoseSample, Measurement]:
    now_ns = int(batch.now_ns[0])
    sample = PoseSample(
        stamp_ns=now_ns - 100,
        status=Status.OK,
        pose=Pose(position_enu_m=np.array([1.0, 2, 30]), wxyz=camera_attitude(0.5, 0.0, 1.0)),
        lat_rad=0.5,
        lon_rad=0.25,
        alt_msl_m=100.0,
    )
    value = Measurement(
        name="w/a",
        kind=ProbeKind.DISTANCE,
        status=Status.OK,
        reasons=(),
        stamp_ns=sample.stamp_ns,
        pixels=((1.0, 2.0), (3.0, 4.0)),
        std_px=1.0,
        camera="cam",
        model=ProjectionModel.PINHOLE,
        pose=sample,
        value=float(now_ns % 1000),
    )
    return sample, value


def settings(**changes: object) -> RecorderSettings:
    return RecorderSettings(**{"station": "s", "camera": CAMERA, "lossless": True, "max_image_hz": 100.0, **changes})


def record(folder: Path, steps: int = 40, **changes: object) -> McapRecorder:
    recorder = McapRecorder(folder, settings(**changes), started_ns=START_NS, texts={"config.toml": "a = 1\n"})
    for step in range(1, steps + 1):
        batch = a_batch(step)
        take(recorder, batch, *outputs_of(batch))
    recorder.close()
    return recorder


def ticks_of(source: RecordingSource) -> list[Batches]:
    steps = MergedFeed([source], TICK_NS, idle_ticks_ns=0).batches()
    return [step[tick : tick + 1] for step in steps for tick in range(len(step))]


def flat(batch: Batches) -> tuple[object, ...]:
    blocks = [
        (raw.sender, int(at), raw.data[start : start + size])
        for raw in batch.raw
        for at, start, size in zip(raw.arrival_ns, raw.offset, raw.length, strict=True)
    ]
    images = [(shot.index, shot.stamp_ns, shot.arrival_ns, shot.clock, shot.width_px) for shot in batch.images]
    return batch.now_ns.tolist(), blocks, images, list(batch.observations)


def test_the_stock_reader_finds_everything_valid_and_in_order(tmp_path: Path) -> None:
    totals = record(tmp_path / "r").totals
    times: list[int] = []
    counts: dict[str, int] = {}
    decoders = {"image/1": decode_image, "observation/1": decode_observation, "measurements/1": split_measurements}
    decoders |= {"pose/1": decode_pose, "status/1": decode_status}
    with (tmp_path / "r" / "data_000.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if channel.topic != "aerodft/s/status":
                times.append(message.log_time)
            if channel.message_encoding == "json":
                assert schema is not None
                assert orjson.loads(schema.data) == SCHEMAS[schema.name]
                Draft202012Validator(orjson.loads(schema.data)).validate(orjson.loads(message.data))
                decoders[schema.name.removeprefix("aerodft.")](message.data)
    assert times == sorted(times)
    assert counts == {
        "mavlink": 120,
        "aerodft/s/image": 10,
        "aerodft/s/observation/w%2Fa": 10,
        "aerodft/s/pose": 40,
        "aerodft/s/location": 10,
        "aerodft/s/measurements": 40,
        "aerodft/s/status": 2,
    }
    assert (totals.messages, totals.images, totals.shed_messages, totals.lost) == (sum(counts.values()), 10, 0, 0)
    assert (tmp_path / "r" / "config.toml").read_text() == "a = 1\n"


def test_foxglove_messages_decode_with_the_stock_protobuf_decoder(tmp_path: Path) -> None:
    record(tmp_path / "r")
    found: dict[str, list[object]] = {}
    for name in ("data_000.mcap", "images_000.mcap"):
        with (tmp_path / "r" / name).open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            topics = ["aerodft/s/camera", "aerodft/s/image/jpeg", "aerodft/s/location"]
            for schema, _, message, decoded in reader.iter_decoded_messages(topics=topics):
                assert schema is not None
                found.setdefault(schema.name, []).append((message, decoded))
    assert set(found) == {"foxglove.CameraCalibration", "foxglove.CompressedImage", "foxglove.LocationFix"}
    ((_, camera),) = found["foxglove.CameraCalibration"]
    assert (camera.width, camera.K[0], camera.distortion_model) == (64, CAMERA.fx_px, "plumb_bob")
    message, image = found["foxglove.CompressedImage"][0]
    assert message.log_time == START_NS + 4 * TICK_NS - 15
    assert image.timestamp.ToNanoseconds() == START_NS + 4 * TICK_NS - 22
    assert image.data[:2] == b"\xff\xd8"
    _, fix = found["foxglove.LocationFix"][0]
    assert (fix.latitude, fix.altitude) == (pytest.approx(np.degrees(0.5)), 100.0)


def test_recorded_input_comes_back_as_the_batches_it_was(tmp_path: Path) -> None:
    record(tmp_path / "r")
    recording = Recording(tmp_path / "r")
    assert (recording.station, recording.is_whole, recording.text("config.toml")) == ("s", True, "a = 1\n")
    assert recording.text("calibration.toml") is None
    source = RecordingSource(recording, pixels=True)
    got = ticks_of(source)
    assert [flat(batch) for batch in got] == [flat(a_batch(step)) for step in range(1, 41)]
    shots = [shot for batch in got for shot in batch.images]
    for shot in shots:
        assert shot.pixels is not None
        np.testing.assert_allclose(shot.pixels(), pixels_of(shot.index), atol=3, err_msg="JPEG of a flat image")
    assert len(list(recording.measurements())) == 40


def test_a_part_of_a_recording_can_be_read(tmp_path: Path) -> None:
    record(tmp_path / "r")
    recording = Recording(tmp_path / "r")
    first_ns, stop_ns = START_NS + 10 * TICK_NS, START_NS + 20 * TICK_NS
    part = list(recording.messages(from_ns=first_ns, to_ns=stop_ns))
    assert part == [message for message in recording.messages() if first_ns <= message.log_ns < stop_ns]
    assert {int(message.log_ns) // TICK_NS - START_NS // TICK_NS for message in part} == set(range(10, 20))


def test_segments_roll_over_and_read_as_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aerodft.adapters.recording.write.segmented_writer.FLUSH_S", 0.0)
    record(tmp_path / "r", segment_bytes=20_000)
    recording = Recording(tmp_path / "r")
    assert len(recording.data) > 1
    got = ticks_of(RecordingSource(recording))
    assert [flat(batch) for batch in got] == [flat(a_batch(step)) for step in range(1, 41)]


def test_a_segment_ends_before_its_index_is_more_than_readers_believe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A station may ask for one segment a day, of 350,000 chunks: without its index only the first are found."""
    monkeypatch.setattr("aerodft.adapters.recording.write.segmented_writer.FLUSH_S", 0.0)
    most = 250
    monkeypatch.setattr("aerodft.adapters.recording.write.segment.MOST_INDEX_BYTES", most)
    record(tmp_path / "r", segment_s=86_400.0)
    recording = Recording(tmp_path / "r")
    assert len(recording.data) > 1
    for segment in recording.data:
        with segment.path.open("rb") as file:
            summary = make_reader(file).get_summary()
        assert summary is not None
        size = sum(90 + 10 * len(each.message_index_offsets) for each in summary.chunk_indexes)
        assert size < most + 2 * (90 + 10 * 8)
    got = ticks_of(RecordingSource(recording))
    assert [flat(batch) for batch in got] == [flat(a_batch(step)) for step in range(1, 41)]


def test_the_image_rate_is_limited_and_none_are_kept_at_zero(tmp_path: Path) -> None:
    assert record(tmp_path / "a", steps=80, max_image_hz=1.0).totals.images == 4
    assert record(tmp_path / "b", steps=8, max_image_hz=0.0).totals.images == 0


def test_images_are_shed_before_data_and_the_caller_never_waits(tmp_path: Path) -> None:
    gate = threading.Event()

    def slow() -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
        gate.wait(30)
        return pixels_of(0)

    recorder = McapRecorder(
        tmp_path / "r", settings(lossless=False, max_image_hz=1e6, queued_images=2), started_ns=START_NS
    )
    for step in range(1, 31):
        now_ns = START_NS + step * TICK_NS
        shot = Image(index=step, stamp_ns=now_ns, arrival_ns=now_ns, width_px=64, height_px=48, pixels=slow)
        take(recorder, one_tick(now_ns, [shot]))
    gate.set()
    recorder.close()
    totals = recorder.totals
    assert totals.images + totals.shed_images == 30
    assert totals.shed_images >= 27
    assert (totals.shed_messages, totals.messages) == (0, 32)


def test_a_full_queue_sheds_data_and_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    recorder = McapRecorder(tmp_path / "r", settings(lossless=False, queue_bytes=1), started_ns=START_NS)
    for step in range(1, 2001):
        take(recorder, a_batch(step, pixels=False))
    recorder.close()
    totals = recorder.totals
    sent = 2000 * 3 + 500 * 2
    assert totals.messages - 2 + totals.shed_messages == sent
    assert totals.shed_messages > 0
    assert "data is shed" in caplog.text
    assert "recording in" in caplog.text
    decode_status(list(Recording(tmp_path / "r").messages())[-1].data)


def test_an_image_that_cannot_be_decoded_does_not_stop_the_others(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def broken() -> np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]:
        raise InputError("image cannot be decoded")

    recorder = McapRecorder(tmp_path / "r", settings(), started_ns=START_NS)
    bad = Image(index=0, stamp_ns=1, arrival_ns=START_NS + 1, width_px=4, height_px=4, pixels=broken)
    take(recorder, one_tick(START_NS + TICK_NS, [bad]))
    take(recorder, a_batch(4))
    recorder.close()
    assert recorder.totals.images == 1
    assert "cannot be recorded" in caplog.text


def test_a_recording_is_never_written_over_something_else(tmp_path: Path) -> None:
    (tmp_path / "keep.txt").write_text("mine")
    with pytest.raises(InputError, match=r"keep.txt in it, expected a new or empty folder"):
        McapRecorder(tmp_path, settings(), started_ns=START_NS)
    assert [path.name for path in tmp_path.iterdir()] == ["keep.txt"]
    with pytest.raises(InputError, match="cannot be written"):
        McapRecorder(tmp_path / "keep.txt" / "r", settings(), started_ns=START_NS)


@pytest.mark.parametrize(
    ("camera", "model"),
    [
        ({"distortion": (0.1, 0.2, 0.0, 0.0)}, "plumb_bob"),
        ({"distortion": (0.1,) * 8}, "rational_polynomial"),
        ({"distortion": (0.1,) * 4, "lens": LensModel.FISHEYE}, "fisheye_opencv"),
    ],
)
def test_every_lens_has_a_name_that_viewers_know(tmp_path: Path, camera: dict[str, object], model: str) -> None:
    lens = Camera(name="c", width_px=4, height_px=4, fx_px=4, fy_px=4, cx_px=1, cy_px=1, **camera)
    recorder = McapRecorder(tmp_path / "r", settings(camera=lens), started_ns=START_NS)
    recorder.close()
    with (tmp_path / "r" / "images_000.mcap").open("rb") as file:
        ((_, _, _, decoded),) = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
    assert decoded.distortion_model == model


def test_a_file_or_an_empty_folder_is_no_recording(tmp_path: Path) -> None:
    for path, got in ((tmp_path / "none", "no such file or folder"), (tmp_path, "an empty folder")):
        with pytest.raises(InputError, match=got):
            Recording(path)
    (tmp_path / "a.txt").write_text("x")
    with pytest.raises(InputError, match=r"a.txt and no data"):
        Recording(tmp_path)
    with pytest.raises(InputError, match="got text"):
        Recording(tmp_path / "a.txt")
    (tmp_path / "data_000.mcap").write_bytes(b"")
    with pytest.raises(NoAnswerError, match="holds nothing"):
        Recording(tmp_path)
    (tmp_path / "data_000.mcap").write_bytes(b"no mcap at all")
    with pytest.raises(InputError, match="no MCAP"):
        Recording(tmp_path)
    (tmp_path / "data_000.mcap").write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(NoAnswerError, match="holds nothing"):
        Recording(tmp_path)


def cut_copy(source: Path, target: Path, size: int) -> Recording:
    target.mkdir()
    (target / "data_000.mcap").write_bytes((source / "data_000.mcap").read_bytes()[:size])
    return Recording(target)


def test_a_cut_recording_is_read_as_far_as_it_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("aerodft.adapters.recording.write.segmented_writer.FLUSH_S", 0.0)
    record(tmp_path / "r")
    whole = [message.data for message in Recording(tmp_path / "r").messages()]
    size = (tmp_path / "r" / "data_000.mcap").stat().st_size
    first = Recording(tmp_path / "r").data[0].chunks[0]
    previous = 0
    for number, part in enumerate(range(first.offset + first.length, size - 1, 3001)):
        recording = cut_copy(tmp_path / "r", tmp_path / f"cut{number}", part)
        got = [message.data for message in recording.messages()]
        assert got == whole[: len(got)]
        assert len(got) >= previous
        assert not recording.is_whole
        previous = len(got)
    assert previous > 0
    assert "was not finished" in caplog.text


def test_a_damaged_chunk_is_left_out_and_never_read_wrongly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("aerodft.adapters.recording.write.segmented_writer.FLUSH_S", 0.0)
    record(tmp_path / "r", steps=30)
    whole = [message.data for message in Recording(tmp_path / "r").messages()]
    chunks = Recording(tmp_path / "r").data[0].chunks
    content = bytearray((tmp_path / "r" / "data_000.mcap").read_bytes())
    victim = chunks[len(chunks) // 2]
    content[victim.offset + victim.length // 2] ^= 0x40
    (tmp_path / "r" / "data_000.mcap").write_bytes(content)
    got = [message.data for message in Recording(tmp_path / "r").messages()]
    assert 0 < len(got) < len(whole)
    rest = iter(whole)
    assert all(data in rest for data in got), "a subsequence"
    assert "damaged chunk" in caplog.text


def run(code: str, *arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", textwrap.dedent(code), *arguments], stdout=subprocess.PIPE)


WRITE_FOREVER = """
    import sys
    from pathlib import Path
    import numpy as np
    from aerodft.adapters.recording.write.recorder import McapRecorder
    from aerodft.adapters.recording.write import RecorderSettings
    from aerodft.model.camera import Camera
    from aerodft.model.telemetry import WireProtocol
    from aerodft.service.batches import Batches
    from aerodft.service.feed import block_of
    from aerodft.service.ports import StepOutputs
    camera = Camera.from_fov(name="c", width_px=4, height_px=4, hfov_rad=1, vfov_rad=1)
    recorder = McapRecorder(
        Path(sys.argv[1]), RecorderSettings(station="s", camera=camera, lossless=True), started_ns=1
    )
    print("open", flush=True)
    for step in range(1, 10_000_000):
        frames = [b"%08d" % (step * 10 + k) for k in range(10)]
        arrivals_ns = range(step * 100 - 9, step * 100 + 1)
        block = [block_of(WireProtocol.MAVLINK, "a", arrivals_ns, frames)]
        recorder.take(Batches.from_events(np.array([step * 100]), block), StepOutputs())
        if step == 3000:
            print("busy", flush=True)
"""


@pytest.mark.parametrize("word", [b"busy", *at_night(b"open")])
def test_a_killed_recorder_leaves_a_recording(tmp_path: Path, word: bytes) -> None:
    with run(WRITE_FOREVER, str(tmp_path / "r")) as process:
        assert process.stdout is not None
        while process.stdout.readline().strip() != word:
            assert process.poll() is None
        process.kill()
    recording = Recording(tmp_path / "r")
    assert not recording.is_whole
    messages = list(recording.messages())
    assert decode_status(messages[0].data).state == "starting"
    frames = [int(message.data) for message in messages[1:]]
    assert frames == list(range(10, 10 + len(frames))), "nothing lost in between, nothing twice"


FULL_DISK = """
    import os, resource, signal, sys, time
    from pathlib import Path
    import numpy as np
    from aerodft.adapters.recording.write import segmented_writer
    from aerodft.adapters.recording.write.recorder import McapRecorder
    from aerodft.adapters.recording.write import RecorderSettings
    from aerodft.model.camera import Camera
    from aerodft.model.telemetry import WireProtocol
    from aerodft.service.batches import Batches
    from aerodft.service.feed import block_of
    from aerodft.service.ports import StepOutputs
    segmented_writer.FLUSH_S = 0.01
    most = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    camera = Camera.from_fov(name="c", width_px=4, height_px=4, hfov_rad=1, vfov_rad=1)
    recorder = McapRecorder(
        Path(sys.argv[1]), RecorderSettings(station="s", camera=camera, lossless=True), started_ns=1
    )
    def send(steps):
        for step in steps:
            frame = os.urandom(900)
            block = [block_of(WireProtocol.MAVLINK, "a", [step * 100], [frame])]
            recorder.take(Batches.from_events(np.array([step * 100]), block), StepOutputs())
            time.sleep(0.002)
    send(range(1, 101))
    time.sleep(0.5)  # a lossless recorder waits a tenth of a second for more to do at once
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, most))
    send(range(101, 201))
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    send(range(201, 301))
    recorder.close()
    totals = recorder.totals
    print(totals.offered, totals.messages, totals.lost_messages)
"""


@pytest.mark.nightly
def test_a_disk_that_refuses_for_a_while_costs_nothing(tmp_path: Path) -> None:
    with run(FULL_DISK, str(tmp_path / "r")) as process:
        out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    offered, stored, lost = map(int, out.split())
    assert offered == stored + lost
    recording = Recording(tmp_path / "r")
    assert len(recording.data) > 1
    messages = list(recording.messages())
    assert len(messages) == stored
    frames = [message.log_ns // 100 for message in messages if message.channel.encoding == "mavlink"]
    assert len(frames) + lost in {300, 301}, "the last status perhaps among the lost"
    assert lost == 0, "what comes meanwhile waits"
    assert frames == sorted(set(frames)), "in order, and none twice"


def test_a_recorder_that_waits_loses_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG, logger="aerodft")
    totals = record(tmp_path / "r", steps=400, queue_bytes=500, queued_images=1, jpeg_quality=10).totals
    assert totals.shed_messages == totals.shed_images == totals.lost == 0
    assert totals.images == 100
    assert str(tmp_path / "r") in caplog.text
