"""A flight's ticks recorded together are, message by message, what they are one after the other."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from aerodft.adapters.codec.observations import ObservationList
from aerodft.adapters.images.rate import RateSource
from aerodft.adapters.mavlink.decoding import MavlinkDecoder
from aerodft.adapters.mavlink.tlog import TlogSource
from aerodft.adapters.mcap import recorder as recorder_module
from aerodft.adapters.mcap.recorder import McapRecorder
from aerodft.adapters.mcap.settings import RecorderSettings
from aerodft.cli.wiring import Late
from aerodft.dft.answers import ImageAnswers
from aerodft.model.camera import Camera
from aerodft.model.observation import Observation
from aerodft.model.pose import HeightSource, PoseSample
from aerodft.model.pose_columns import PoseRow, sample_of
from aerodft.model.probe import PixelSource, Probe, ProbeKind
from aerodft.service.batches import Batches
from aerodft.service.feed import MergedFeed
from aerodft.service.pipeline import Pipeline
from aerodft.service.ports import Output
from aerodft.service.settings import HeightSettings, PipelineSettings, TelemetrySettings
from aerodft.sim.plan import Waypoint, fly
from aerodft.sim.scenario import EPOCH_NS
from aerodft.sim.telemetry import Autopilot, datagrams, write_tlog
from aerodft.sim.world import DEFAULT_ORIGIN
from replay.recording import Recording

SECONDS, TICK_NS = 40.0, 50_000_000
CAMERA = Camera.from_fov(name="cam", width_px=1920, height_px=1080, hfov_rad=1.1, vfov_rad=0.66)
SETTINGS = PipelineSettings(
    station="s",
    camera=CAMERA,
    probes=(
        Probe(name="seen", kind=ProbeKind.RANGE, source=PixelSource.OBSERVED, std_px=2.0),
        Probe(name="width", kind=ProbeKind.WIDTH, pixels=((500.0, 820.0), (1500.0, 810.0))),
        Probe(name="far", kind=ProbeKind.POSITION, pixels=((900.0, 30.0),)),
    ),
    telemetry=TelemetrySettings(height=HeightSettings(order=(HeightSource.HOME,))),
    tick_ns=TICK_NS,
)


@pytest.fixture(scope="module")
def feed(tmp_path_factory: pytest.TempPathFactory) -> MergedFeed:
    """A climb and a flight at 20 m with images at 30 Hz, in three of which something is seen."""
    waypoints = ((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (10.0, 0.0, 20.0), (SECONDS, 150.0, 20.0))
    path = fly(
        tuple(
            Waypoint(
                time_s=time_s,
                east_m=0.0,
                north_m=north_m,
                height_m=height_m,
                heading_rad=0.1,
                gimbal_pitch_rad=np.radians(-50.0),
            )
            for time_s, north_m, height_m in waypoints
        ),
        origin=DEFAULT_ORIGIN,
        start_ns=EPOCH_NS,
    )
    log = tmp_path_factory.mktemp("log") / "flight.tlog"
    write_tlog(log, datagrams(path, Autopilot()))
    images = Late(RateSource([(EPOCH_NS, EPOCH_NS + round(SECONDS * 1e9))], 30.0), lateness_ns=120_000_000)
    stamps_ns = [EPOCH_NS + round(second * 1e9) for second in (12.0, 21.3, 30.01)]
    seen = [Observation(name="seen", stamp_ns=at, arrival_ns=at, pixels=((960.0, 600.0),)) for at in stamps_ns]
    observed = Late(ObservationList(seen), lateness_ns=200_000_000)
    return MergedFeed([TlogSource(log), images, observed], TICK_NS)


def pipeline() -> Pipeline:
    return Pipeline(SETTINGS, MavlinkDecoder())


def recorder(folder: Path) -> McapRecorder:
    return McapRecorder(folder, RecorderSettings(station="s", camera=CAMERA, lossless=True), started_ns=EPOCH_NS)


def messages(folder: Path) -> list[tuple[int, str, int, bytes]]:
    found = Recording(folder).messages(wanted=lambda channel: not channel.topic.endswith("/status"))
    return [(each.log_ns, each.channel.topic, each.sequence, each.data) for each in found]


@pytest.fixture(scope="module")
def tick_by_tick(feed: MergedFeed, tmp_path_factory: pytest.TempPathFactory) -> list[tuple[int, str, int, bytes]]:
    folder, made = tmp_path_factory.mktemp("recording") / "ticks", pipeline()
    recording = recorder(folder)
    for batch in feed.batches():
        recording.inputs(batch)
        recording.outputs(made.step(batch))
    recording.close()
    return messages(folder)


@pytest.mark.parametrize("cores", [1, 2])
@pytest.mark.parametrize("ticks", [53, 100_000])
def test_spans_are_recorded_as_their_ticks(
    feed: MergedFeed,
    tick_by_tick: list[tuple[int, str, int, bytes]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    *,
    ticks: int,
    cores: int,
) -> None:
    """Whether a thread writes them or, on one processor, the caller."""
    monkeypatch.setattr(recorder_module, "processors", lambda: cores)
    made, recording = pipeline(), recorder(tmp_path / "spans")
    batches = Batches.of(list(feed.batches()))
    together = apart = 0
    for first, stop in pairwise([*range(0, len(batches), ticks), len(batches)]):
        span = made.advance(batches[first:stop])
        together += sum(len(block.images) for block in span.together)
        apart += len(span.apart)
        recording.span(batches[first:stop], span)
    recording.close()
    totals = recording.totals
    assert together > 800
    assert apart > 3  # what is seen, and what comes before the clocks are known
    assert messages(tmp_path / "spans") == tick_by_tick
    assert len(tick_by_tick) > 6_000
    assert totals.offered == totals.messages >= len(tick_by_tick)


def test_what_ticks_come_to_can_be_cut_and_asked_for_one_by_one(feed: MergedFeed) -> None:
    batches, made = list(feed.batches()), pipeline()
    alone = [tuple(map(plain, made.step(batch))) for batch in batches]
    span = pipeline().advance(batches)
    assert [tuple(map(plain, outputs)) for outputs in span] == alone
    assert [tuple(map(plain, span[tick])) for tick in range(-300, -200)] == alone[-300:-200]
    assert [tuple(map(plain, outputs)) for outputs in span.between(111, 333)] == alone[111:333]


def plain(output: Output) -> object:
    """What an output says, comparable."""
    if isinstance(output, ImageAnswers):
        return output.image, output.stamp_ns, [(each.name, each.value, each.std, each.status) for each in output]
    if isinstance(output, PoseSample | PoseRow):
        sample = sample_of(output)
        return sample.stamp_ns, sample.status, None if sample.pose is None else sample.pose.cov.tolist()
    return type(output), getattr(output, "stamp_ns", None), getattr(output, "index", None)
