"""Where ports meet adapters: pipelines, recorders and feeds out of a station's configuration."""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from aerodft.adapters.config.station import (
    COPY_NAME,
    StationConfig,
    copy_terrain,
    resolved_toml,
    travels,
)
from aerodft.adapters.outputs import Run
from aerodft.adapters.recording.write import McapRecorder, RecorderSettings
from aerodft.adapters.telemetry import decoder_of
from aerodft.adapters.wire.requests import MeasureRequest
from aerodft.dft import Request
from aerodft.errors import ConfigError, InputError
from aerodft.model import Measurement
from aerodft.service import Batches, Feed, Inbox, Pipeline, Sink

_log = logging.getLogger(__name__)


def build_pipeline(station: StationConfig) -> Pipeline:
    """The pipeline of a station, with its decoder and its calibration, which landmarks or steady points refine.

    Raises:
        ConfigError: The images' clock is still to be found.
    """
    if station.images.is_auto:
        hint = "`import_flight` finds it, `align` says it"
        raise ConfigError("images.time_offset_s", got='"auto"', expected="a number", hint=hint)
    decoder = decoder_of(station.pipeline.telemetry)
    tracker = None
    if station.objects is not None:
        from aerodft.vision.objects import ObjectTracks  # noqa: PLC0415 - slow to load, as each calibrator is

        tracker = ObjectTracks(station.objects)
    if station.live is not None:
        from calibration.live import LiveCalibrator  # noqa: PLC0415

        live = LiveCalibrator(station.live, station.pipeline, station.calibration)
        return Pipeline(station.pipeline, decoder, live, live, tracker)
    if station.camera_motion is not None:
        from calibration.camera_motion import CameraMotionCalibrator  # noqa: PLC0415

        steady = CameraMotionCalibrator(station.camera_motion, station.pipeline)
        return Pipeline(station.pipeline, decoder, steady, steady, tracker)
    if station.calibration is not None:
        from calibration.flight import BiasCalibrator  # noqa: PLC0415

        return Pipeline(station.pipeline, decoder, BiasCalibrator(station.calibration), tracker=tracker)
    return Pipeline(station.pipeline, decoder, tracker=tracker)


def outputs_run(station: StationConfig, pipeline: Pipeline, inbox: Inbox | None = None) -> Run:
    """A run as its outputs see it: live with an inbox, else from files."""

    def measure(question: MeasureRequest) -> list[Measurement]:
        probe = question.probe
        request = Request(probe=probe, pixels=probe.pixels, std_px=probe.std_px)
        return pipeline.measure_at((request,), question.stamp_ns)

    return Run(
        station=station.pipeline.station,
        probes=station.pipeline.probes,
        is_live=inbox is not None,
        measure=measure,
        put_observation=inbox.put_observation if inbox is not None and station.observations.topic else None,
        in_utc=pipeline.in_utc,
    )


def build_recorder(
    station: StationConfig,
    folder: Path,
    *,
    started_ns: int,
    lossless: bool,
    image_hz: float | None = None,
    texts: Mapping[str, str] | None = None,
) -> McapRecorder:
    """A recorder into a new folder; the configuration is written beside the segments, complete in itself.

    An elevation model travels with it, where it is one file of moderate size; its name there is in the configuration.

    ``image_hz`` takes the place of the configuration's; ``texts`` are further files, by name, that go with it.
    """
    settings = RecorderSettings(
        station=station.pipeline.station,
        camera=station.pipeline.camera,
        lossless=lossless,
        max_image_hz=station.record.image_hz if image_hz is None else image_hz,
        video=station.record.video,
        jpeg_quality=station.record.jpeg_quality,
        segment_s=station.record.segment_s,
        segment_bytes=round(station.record.segment_mb * 1e6),
    )
    terrain = None if station.ground is None else station.ground.path
    copied = terrain is not None and travels(terrain)
    text = resolved_toml(station, terrain_file=COPY_NAME if copied else None)
    recorder = McapRecorder(folder, settings, started_ns=started_ns, texts={"config.toml": text, **(texts or {})})
    if terrain is not None and not copied:
        _log.warning("%s is not copied into the recording, which needs it to be computed anew", terrain)
    elif terrain is not None:
        try:
            copy_terrain(terrain, folder)
        except InputError:
            recorder.close()
            raise
    return recorder


@contextmanager
def closing_recorder(recorder: McapRecorder, folder: Path) -> Iterator[None]:
    """Close a recorder at the end; where the end came early, say that what there is was kept."""
    try:
        yield
    except BaseException:
        recorder.close()
        _log.warning("not finished; %s holds what was read so far", folder)
        raise
    recorder.close()


def run(feed: Feed, pipeline: Pipeline, sinks: Sequence[Sink], on_tick: Callable[[int], None] | None = None) -> None:
    """Drive a pipeline with a feed until it ends; every sink sees every input and output.

    Args:
        feed: What is read.
        pipeline: What measures.
        sinks: Who takes inputs and outputs.
        on_tick: Called between two batches with the time that has been reached; what it raises ends the run there.
    """
    now_ns = 0
    for batches in feed.batches():
        now_ns = int(batches.now_ns[-1])
        outputs = pipeline.advance(batches)
        for sink in sinks:
            sink.take(batches, outputs)
        del outputs  # some megabytes, which are not kept while the next are made
        if on_tick is not None:
            on_tick(now_ns)
    outputs = pipeline.finish()
    for sink in sinks:
        sink.take(Batches(now_ns=np.array([now_ns])), outputs)
