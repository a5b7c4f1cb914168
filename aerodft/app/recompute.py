"""Computing recordings anew: the pipeline over the input that they hold, with another configuration or calibration."""

import glob
import logging
import os
import shutil
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import tomli_w

from aerodft.adapters.config.station import NO_SETTINGS, Settings, StationConfig, resolved_toml
from aerodft.adapters.recording.read import PROVENANCE_NAME, SegmentScan
from aerodft.adapters.wire.measurement import encode_measurement
from aerodft.app import Progress, assembly, no_progress
from aerodft.errors import AerodftError, InputError, NoAnswerError, UsageError, os_errors_as
from aerodft.service import Feed, MergedFeed, Pipeline, Source
from replay.batch import Dataset, InputKey, Job, JobOutcome, JobState, input_key, jobs_of, recording_hash, run_batch
from replay.recordings import Recording, RecordingSource, Redetection, RedetectionStatistics

_FROM_IMAGE_TO_IMAGE: Final = {"objects": "[objects]", "tracked": "tracked probes"}

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecomputeResult(assembly.RunResult):
    """Result of a recording computed anew, compared with what it was computed from.

    Attributes:
        provenance: What it was computed from: recording, its hash, station, camera, configuration and calibration.
        redetection: How far what was found again is from what was recorded; None where nothing was looked for.
        image_segments: How many files of images were copied as they are.
    """

    provenance: Mapping[str, Any]
    redetection: RedetectionStatistics | None = None
    image_segments: int = 0


def recompute(
    recording: str | Path,
    output: str | Path,
    *,
    config: str | Path | None = None,
    calibration: str | Path | None = None,
    settings: Settings = NO_SETTINGS,
    redetect: bool = False,
    progress: Progress = no_progress,
) -> RecomputeResult:
    """Compute a recording's measurements anew, into a new recording.

    With the recording's own configuration the measurements are identical to the byte on the same machine. Images are
    copied, not encoded again.

    Args:
        recording: Folder of the recording.
        output: New folder for the new recording.
        config: Another station file; the alignment of the recorded video is kept unless the file states a clock. None
            for the recording's own configuration.
        calibration: Another calibration file; None for that of the configuration.
        settings: Values that replace those of the configuration, by key of the station file, such as
            ``{"telemetry.height.home_above_plane_m": 3.0}``.
        redetect: Find what aerodft itself saw again in the recorded images; else it starts from the recorded
            observations.
        progress: Called between batches with nanoseconds of the recording; what it raises ends the work there, and
            the new recording holds what was computed so far.

    Raises:
        InputError: The folder is no recording, has no configuration, its images are not of the camera, or the new
            folder cannot be written.
        ConfigError: A configuration or a calibration is not one.
        NoAnswerError: The recording holds nothing, or with ``redetect`` no images.
        UsageError: With ``redetect`` there is nothing to look for.

    Examples:
        >>> import aerodft as ad
        >>> again = ad.recompute("tests/cli/frozen-0.1", "again")
        >>> again.statistics.images, again.statistics.poses["ok"], again.lost
        (30, 27, 0)
    """
    own = None if config is None else Path(config)
    known = None if calibration is None else Path(calibration)
    job = open_recomputation(Path(recording), own, known, settings, redetect=redetect)
    return _recorded(job, Path(output), progress)


def _recorded(job: "Recomputation", output: Path, progress: Progress) -> RecomputeResult:
    """Run a recomputation into a new recording."""
    old, statistics, provenance = job.recording, assembly.RunStatistics(), _provenance_of(job)
    texts = {PROVENANCE_NAME: tomli_w.dumps(provenance, multiline_strings=True)}
    images = old.images if next(old.image_messages(), None) is not None else ()
    recorder = assembly.build_recorder(
        job.station,
        output,
        started_ns=old.start_ns,
        lossless=True,
        image_hz=0.0,
        texts=texts,
        copied=tuple(map(old.copy_of, images)),
    )
    with assembly.closing_recorder(recorder, output):
        span_ns = old.end_ns - old.start_ns
        progress(0, span_ns)
        assembly.run(
            job.feed, job.pipeline, (recorder, statistics), lambda now_ns: progress(now_ns - old.start_ns, span_ns)
        )
        recorder.unmeasured = old.unmeasured
    _copy_images(images, output)
    redetection = job.redetection
    return RecomputeResult(
        totals=recorder.totals,
        statistics=statistics,
        counts=job.pipeline.counts,
        observers={} if redetection is None else job.observers.report(redetection.counts),
        unmeasured=recorder.unmeasured,
        warnings=() if redetection is None else _few_images(tuple(job.observers.by_name), redetection.moved.kept),
        provenance=provenance,
        left_out=old.left_out(images=True),
        redetection=None if redetection is None else redetection.moved,
        image_segments=len(images),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Recomputation:
    """A recording, ready to be computed anew.

    Attributes:
        recording: What is read.
        recorded_station: The configuration that it was made with; where it has none, the one to compute with.
        station: The configuration to compute with.
        pipeline: The pipeline of ``station``.
        feed: The recording's input as that configuration stamps it.
        settings: Values by which the configuration was changed.
        redetection: What is looked for again in the recorded images; None where observations are taken as recorded.
        observers: What looks for it.
    """

    recording: Recording
    recorded_station: StationConfig
    station: StationConfig
    pipeline: Pipeline
    feed: Feed
    settings: Settings = field(default_factory=dict)
    redetection: Redetection | None = None
    observers: assembly.ImageObservers = field(default_factory=assembly.ImageObservers)


def open_recomputation(
    folder: Path,
    config: Path | None,
    calibration: Path | None,
    settings: Settings = NO_SETTINGS,
    *,
    redetect: bool = False,
) -> Recomputation:
    """Open a recording with its own configuration or another one, and another calibration where there is one.

    Args:
        folder: The recording.
        config: None for its own configuration.
        calibration: None for that of the configuration.
        settings: As in ``recompute``.
        redetect: Look again into the recorded images; else it starts from the recorded observations.

    Raises:
        AerodftError: As for ``recompute``.
    """
    recording = Recording(folder)
    recorded, station = assembly.stations_of(recording, config, calibration, settings)
    pipeline = assembly.build_pipeline(station)
    source = assembly.reoffset(RecordingSource(recording, pixels=redetect), recorded, station)
    redetection, observers = None, assembly.ImageObservers()
    if redetect:
        observers = assembly.build_observers(station, pipeline, config or folder, may_record=True)
        source = redetection = _redetection(source, recording, observers)
    return Recomputation(
        recording=recording,
        recorded_station=recorded,
        station=station,
        pipeline=pipeline,
        feed=MergedFeed([source], station.pipeline.tick_ns),
        settings=settings,
        redetection=redetection,
        observers=observers,
    )


def _redetection(source: Source, recording: Recording, observers: assembly.ImageObservers) -> Redetection:
    if not observers.schedules:
        got = "a configuration without [markers], [camera_motion], [objects], [river] and tracked probes"
        raise UsageError("`redetect`", got=got, expected="one of them: else aerodft looks for nothing itself")
    if next(recording.image_messages(), None) is None:
        hint = "record.image_hz says how many are kept"
        raise NoAnswerError("no images in the recording", where=recording.folder, hint=hint)
    return Redetection(source, observers.schedules)


def _few_images(tables: tuple[str, ...], kept: int) -> tuple[str, ...]:
    """A warning where observers that go from image to image were shown some of the images only."""
    who = " and ".join(_FROM_IMAGE_TO_IMAGE[name] for name in tables if name in _FROM_IMAGE_TO_IMAGE)
    if not kept or not who:
        return ()
    sentence = (
        f"`redetect`: {kept} observations are of images that are not recorded; {who} go from image to image, and find"
        " other things in fewer of them: record every image (record.video = true of an H.264 stream, else image_hz of"
        " the camera's rate or more), or compare without `redetect`"
    )
    return (sentence,)


def _copy_images(images: Sequence[SegmentScan], output: Path) -> None:
    """Copy image segments as they are, numbered from 1."""
    for number, segment in enumerate(images, start=1):
        with os_errors_as("images cannot be copied", where=segment.path, hint="the measurements are complete"):
            shutil.copy2(segment.path, output / f"images_{number:03d}.mcap")


def _provenance_of(job: Recomputation) -> dict[str, Any]:
    """Provenance that new measurements no longer have: the recording they are computed from, and its ids.

    Where it was computed from another one itself, what it says of that one is under ``computed_from``.

    Raises:
        InputError: A segment cannot be read.
    """
    old, recorded = job.recording, job.recorded_station
    known = {
        "recording": str(old.folder.resolve()),
        "recording_sha256": recording_hash([segment.path for segment in old.data]),
        "station": recorded.pipeline.station,
        "camera": recorded.pipeline.camera.name,
        "config": recorded.pipeline.config_id,
        "calibration": None if recorded.calibration is None else recorded.calibration.id,
        "config_toml": old.text("config.toml"),
        "settings": dict(job.settings) or None,
        "computed_from": _earlier_provenance(old),
    }
    return {key: value for key, value in known.items() if value is not None}


def _earlier_provenance(recording: Recording) -> dict[str, Any] | None:
    text = recording.text(PROVENANCE_NAME)
    if text is None:
        return None
    try:
        return tomllib.loads(text)
    except ValueError as error:
        raise InputError("the file is no TOML", where=recording.folder / PROVENANCE_NAME, got=error) from error


def recompute_many(  # noqa: PLR0913 - what a user may choose, by name
    recordings: Sequence[str | Path],
    output: str | Path,
    *,
    config: str | Path | None = None,
    calibration: str | Path | None = None,
    settings: Settings = NO_SETTINGS,
    overwrite: bool = False,
    scheduler: str = "processes",
    workers: int | None = None,
    progress: Progress = no_progress,
) -> list[JobOutcome]:
    """Compute recordings anew into a Parquet dataset, several at once; what is done already is not done again.

    Args:
        recordings: Folders of recordings, and patterns for folders.
        output: The dataset's folder.
        config: Another station file for all of them; None for each one's own configuration.
        calibration: Another calibration file for all of them; None for that of each configuration.
        settings: Values that replace those of each configuration, as in ``recompute``.
        overwrite: Replace rows that the dataset has of other input.
        scheduler: ``processes`` of this machine, or the address of a Dask scheduler.
        workers: Processes of this machine; None for one a core.
        progress: Called with how many recordings are done.

    Returns:
        What became of each recording.

    Raises:
        InputError: There is no such recording, the scheduler cannot be reached, or the dataset cannot be written.
    """
    dataset = Dataset.at(Path(output))
    jobs = jobs_of(_folders([str(each) for each in recordings], Path(output)))
    work = partial(
        recompute_rows,
        dataset=dataset,
        config=None if config is None else Path(config).resolve(),
        calibration=None if calibration is None else Path(calibration).resolve(),
        settings=settings,
        overwrite=overwrite,
    )
    outcomes: dict[str, JobOutcome] = {}
    for outcome in run_batch(jobs, work, scheduler, workers or len(os.sched_getaffinity(0))):
        outcomes[outcome.recording] = outcome
        progress(len(outcomes), len(jobs))
        if outcome.sentence:
            _log.warning("%s", outcome.sentence)
    return [outcomes[job.recording] for job in jobs]


def is_pattern(recording: str) -> bool:
    """Whether a name is a pattern for several recordings."""
    return glob.has_magic(recording) and not Path(recording).exists()


def _folders(recordings: Sequence[str], output: Path) -> list[Path]:
    """The folders that are meant, each once, in order of their names within a pattern."""
    found: dict[Path, None] = {}
    for each in recordings:
        matching = sorted(glob.glob(each)) if is_pattern(each) else [each]  # noqa: PTH207 - an absolute one as well
        for path in map(Path, matching):
            if path.is_file() and path.suffix != ".mcap":
                _log.warning("%s: no recording; left out", path)
            elif path.resolve() != output.resolve():
                found.setdefault(path.resolve())
    if not found:
        where = ", ".join(recordings)
        raise InputError("there is no recording", where=where, got="nothing", expected="folders with data_000.mcap")
    return list(found)


def recompute_rows(
    job: Job,
    *,
    dataset: Dataset,
    config: Path | None = None,
    calibration: Path | None = None,
    settings: Settings = NO_SETTINGS,
    overwrite: bool = False,
) -> JobOutcome:
    """Compute one recording anew into its part of the dataset; skips what is done. Runs in a worker's process."""
    from replay.export import ParquetRows, parse_measurement  # slow to load, and one recording has no table

    try:
        opened = open_recomputation(job.folder, config, calibration, settings)
        key = _key(opened)
        done = dataset.done(job.recording, key)
        if done is not None:
            return _outcome(job, JobState.SKIPPED, done, dataset.left_out(job.recording, key))
        statistics, recorded = assembly.RunStatistics(), opened.recorded_station
        with dataset.part(job.recording, key, overwrite=overwrite) as part:
            constants = {
                "recording_folder": str(job.folder),
                "recording_sha256": key.recording,
                "recorded_config": recorded.pipeline.config_id,
                "recorded_calibration": None if recorded.calibration is None else recorded.calibration.id,
            }
            with ParquetRows(part.path, constants=constants, metadata=part.metadata) as rows:
                sink = assembly.MeasurementSink(
                    lambda measurement: rows.add([parse_measurement(encode_measurement(measurement))])
                )
                assembly.run(opened.feed, opened.pipeline, (sink, statistics))
                if not rows.count:
                    raise NoAnswerError("nothing was measured", where=job.folder, got="no probe in any image")
                left_out = opened.recording.left_out().sentence
                rows.describe(dataset.statuses_text(statistics.measurements, left_out))
        return _outcome(job, JobState.DONE, statistics.measurements, left_out)
    except AerodftError as error:
        sentence = str(error) if str(job.folder) in str(error) else f"{job.folder}: {error}"
        return JobOutcome(recording=job.recording, state=JobState.FAILED, sentence=sentence)


def _outcome(job: Job, state: JobState, statuses: Mapping[str, int], left_out: str) -> JobOutcome:
    sentence = f"{job.folder}: {left_out}" if left_out else ""
    return JobOutcome(recording=job.recording, state=state, statuses=dict(statuses), sentence=sentence)


def _key(opened: Recomputation) -> InputKey:
    """Hashes of all that the numbers follow from: recorded input, its configuration and the one to use."""
    texts = (opened.recording.text("config.toml") or "", resolved_toml(opened.station))
    return input_key([segment.path for segment in opened.recording.data], texts)
