"""A station that measures live: MAVLink and images in, measurements out on the bus and into a recording."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self

import numpy as np

from aerodft.adapters.config.station import Device, Rate, StationConfig, Stills, StreamInput, VideoFile, load_station
from aerodft.adapters.images import LiveRate, StreamReader
from aerodft.adapters.outputs import Output, open_outputs
from aerodft.adapters.telemetry import opened_signing, signing_sentences
from aerodft.adapters.telemetry.mavlink import MavlinkLink, parse_address
from aerodft.adapters.wire.status import UNMEASURED, StationStatus
from aerodft.app import assembly
from aerodft.app.recordings import recovering_beside
from aerodft.conventions import SECOND_NS
from aerodft.errors import ConfigError, InputError, named_in
from aerodft.model import GeoOrigin, Image, Measurement, StampClock, VideoPacket, WireProtocol
from aerodft.service import Batches, Inbox, LiveFeed, LiveObservers, Sink, block_of
from aerodft.service.clocks import WallClock
from aerodft.sim import DEFAULT_RATES_HZ, Autopilot, Waypoint, datagrams, fly

if TYPE_CHECKING:
    from aerodft.adapters.recording.write import McapRecorder

_WAKE_S: Final = 0.5  # Python handles a signal when the main thread runs: one that came just before a wait is not lost


class Station:
    r"""A station that measures live while its ``with`` block lasts: every configured probe, for every image.

    Entering opens links, bus and recording, and starts to measure in a thread of its own; leaving ends that, and
    closes the recording. What ended the station early is raised then.

    Args:
        config: Station file, or a station.
        output: New folder for the recording; None for one under the station's ``record.folder``.

    Attributes:
        recording: Folder of the recording.
        status: State, counts and health as of the last second; None before the first one.

    Raises:
        ConfigError: The file is wrong, names recorded images, or has telemetry without a connection.

    Examples:
        >>> from pathlib import Path
        >>> import aerodft as ad
        >>> text = Path("configs/services/fixed-camera.toml").read_text()
        >>> stream = 'stream = "rtsp://127.0.0.1:8554/bridge"'
        >>> text = text.replace(stream, "rate_hz = 20.0").replace("[zenoh]", "[zenoh]\nenabled = false")
        >>> _ = Path("station.toml").write_text(text)
        >>> names = set()
        >>> with ad.Station("station.toml", output="rec") as station:
        ...     station.on_measurement(lambda measurement: names.add(measurement.name))
        ...     station.wait(seconds=1.0)
        >>> sorted(names)
        ['crossing', 'deck', 'gauge', 'pier']
    """

    def __init__(self, config: str | Path | StationConfig, *, output: str | Path | None = None) -> None:
        where = "" if isinstance(config, StationConfig) else str(config)
        self._config = station = config if isinstance(config, StationConfig) else load_station(Path(config))
        if station.pipeline.telemetry is not None and station.link is None:
            expected = 'e.g. "udpin:127.0.0.1:14550"'
            raise ConfigError("telemetry.connection", where=where, got="none", expected=expected)
        if isinstance(station.images.source, VideoFile | Stills):
            expected = "stream, device or rate_hz"
            raise ConfigError("images", where=where, got="recorded images", expected=expected, hint="use import")
        self._where = where
        self._clock = WallClock()
        self._statistics = assembly.RunStatistics()
        self._sinks: list[Sink] = [self._statistics]
        self._pipeline = assembly.build_pipeline(station)
        self._inbox = Inbox(self._clock)
        self._feed = LiveFeed(self._inbox, self._clock, station.pipeline.tick_ns)
        self._observers = assembly.ImageObservers()
        self._live_observers = LiveObservers((), self._inbox.put_observations)
        self._outputs: tuple[Output, ...] = ()
        self._added: list[Output] = []
        self._link: MavlinkLink | None = None
        self._stream: StreamReader | None = None
        self._recorder: McapRecorder | None = None
        self._receivers: tuple[Output | McapRecorder, ...] = ()
        self._opened = ExitStack()
        self._thread = threading.Thread(target=self._run, name="station")
        self._error: BaseException | None = None
        self._next_status_ns = 0
        self.status: StationStatus | None = None
        started = datetime.fromtimestamp(self._clock.now_ns() // SECOND_NS, UTC)
        name = f"{station.pipeline.station}-{started:%Y%m%d-%H%M%S}"
        self.recording = station.record.folder / name if output is None else Path(output)

    def on_measurement(self, callback: Callable[[Measurement], None]) -> None:
        """Have every measurement from now on handed to a function, in the station's thread.

        Args:
            callback: Called with each measurement in order; while it takes long, answers wait. What it raises ends the
                station.
        """
        self._sinks.append(assembly.MeasurementSink(callback))

    @property
    def file(self) -> Path | None:
        """File of the station's configuration; None where it was given a configuration."""
        return Path(self._where) if self._where else None

    @property
    def config(self) -> StationConfig:
        """Configuration of the station."""
        return self._config

    def add_output(self, output: Output) -> None:
        """Have an output take what is read and measured, beside those of the configuration.

        Args:
            output: Must not block; it is closed when the station is left.
        """
        self._added.append(output)

    def stop(self) -> None:
        """End once all that has arrived is measured; from any thread or signal handler."""
        self._feed.stop()

    def wait(self, seconds: float | None = None) -> None:
        """Wait until the station has ended.

        Args:
            seconds: How long at most; None for as long as it takes.
        """
        until_s = math.inf if seconds is None else time.monotonic() + seconds
        while self._thread.is_alive() and (left_s := until_s - time.monotonic()) > 0:
            self._thread.join(min(left_s, _WAKE_S))

    @property
    def output_warnings(self) -> tuple[str, ...]:
        """Sentences on failures of the outputs; complete once the ``with`` block was left."""
        return tuple(sentence for output in self._outputs for sentence in output.warnings())

    @property
    def result(self) -> assembly.RunResult:
        """Totals of the run so far; complete once the ``with`` block was left.

        Raises:
            ValueError: It was not entered yet.
        """
        if self._recorder is None:
            raise ValueError("the station has not been entered: there is no recording")
        signing = None if self._link is None else self._link.signing
        return assembly.RunResult(
            totals=self._recorder.totals,
            statistics=self._statistics,
            counts=self._pipeline.counts,
            observers=self._observers.report(self._live_observers.counts),
            unmeasured=self._unmeasured(),
            warnings=() if signing is None else tuple(signing_sentences(signing)),
        )

    def __enter__(self) -> Self:
        """Open everything, and start to measure.

        Raises:
            InputError: A port, stream, key or folder cannot be used.
            ConfigError: There is something to look for, and no images.
        """
        self._pipeline.warm_up()
        warm_up(self._config)
        with ExitStack() as stack, named_in(Path(self._where)):
            self._observers = assembly.build_observers(self._config, self._pipeline, self._where)
            started_ns = self._clock.now_ns()
            stack.enter_context(recovering_beside(self._config.record.folder))  # what a power cut left unfinished
            outputs = open_outputs(
                self._config.outputs, assembly.outputs_run(self._config, self._pipeline, self._inbox)
            )
            for each in self._added:
                stack.callback(each.close)
            self._outputs = (*stack.enter_context(outputs), *self._added)
            observers = LiveObservers(self._observers.schedules, self._inbox.put_observations)
            self._live_observers = stack.enter_context(observers)
            self._open_images(stack)
            self._open_link(stack)
            # Once nothing else can fail: packets that came before are not recorded.
            self._recorder = assembly.build_recorder(
                self._config, self.recording, started_ns=started_ns, lossless=False
            )
            stack.callback(self._recorder.close)
            self._receivers = (*self._outputs, self._recorder)
            self._sinks[:0] = self._receivers
            self._thread.start()
            self._opened = stack.pop_all()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """End the station, and close what it opened.

        Raises:
            AerodftError: What ended the station early.
        """
        with self._opened:
            self.stop()
            self.wait()
        if self._error is not None and error is None:
            raise self._error

    def _run(self) -> None:
        try:
            assembly.run(self._feed, self._pipeline, self._sinks, self._tell_status)
        except BaseException as error:  # noqa: BLE001 - raised where the station is left
            self._error = error

    def _open_images(self, stack: ExitStack) -> None:
        source = self._config.images.source
        if isinstance(source, StreamInput | Device):
            reader = StreamReader(
                source.url if isinstance(source, StreamInput) else source.path,
                self._take_image,
                clock=self._clock,
                on_packet=self._take_packet,
                time_offset_s=self._config.image_offset_s,
            )
            self._stream = stack.enter_context(reader)
        else:
            rate_hz = source.rate_hz if isinstance(source, Rate) else assembly.DEFAULT_RATE_HZ
            rate = LiveRate(rate_hz, self._inbox.put_image, self._clock)
            rate.start()
            stack.callback(rate.stop)

    def _open_link(self, stack: ExitStack) -> None:
        link = self._config.link
        if link is not None and self._config.pipeline.telemetry is not None:
            check = stack.enter_context(opened_signing(link.signing))
            address = parse_address(link.connection, baud=link.baud)
            self._link = stack.enter_context(MavlinkLink(address, self._inbox, signing=check))

    def _take_packet(self, packet: VideoPacket) -> None:
        if self._recorder is not None:
            self._recorder.packet(packet)

    def _take_image(self, image: Image) -> None:
        """Pass an image to the inbox and the observers; one of another size than the camera's ends the station."""
        try:
            assembly.check_size(image, self._config.pipeline.camera, "image stream")
        except InputError as refusal:
            self._error = refusal
            self.stop()
        else:
            self._inbox.put_image(image)
            self._live_observers(image)

    def _tell_status(self, now_ns: int) -> None:
        """Publish and record the station's state once a second of ticks."""
        if now_ns < self._next_status_ns:
            return
        self._next_status_ns = now_ns + SECOND_NS
        last = self._pipeline.last_pose
        self.status = StationStatus(
            station=self._config.pipeline.station,
            stamp_ns=now_ns,
            state="running",
            text="no image yet" if last is None else "; ".join((str(last.status), *last.reasons)),
            counts=self._counts(),
            health=self._pipeline.health(now_ns),
            rejected=self._pipeline.rejected(),
        )
        for receiver in self._receivers:
            receiver.status(self.status)

    def _counts(self) -> dict[str, int]:
        looks, statistics = self._live_observers.counts, self._statistics
        return {
            "images": statistics.images,
            "looks": sum(each.looked for each in looks),
            "skipped_looks": sum(each.skipped for each in looks),
            **{f"{UNMEASURED}{cause}": number for cause, number in self._unmeasured().items()},
            **({} if self._link is None else _link_counts(self._link)),
            **({} if self._recorder is None else self._recorder.totals.counts),
            **{f"poses_{status}": number for status, number in statistics.poses.items()},
            **{f"measurements_{status}": number for status, number in statistics.measurements.items()},
        }

    def _unmeasured(self) -> dict[str, int]:
        """Images that came and were never measured, by cause."""
        left_out = {} if self._stream is None else self._stream.status.left_out
        return {**left_out, "dropped": self._inbox.dropped_images}


def _link_counts(link: MavlinkLink) -> dict[str, int]:
    """Counts of the link's frames: heard, let in and refused."""
    seen = link.counts
    counts = {"frames": seen.frames, "frames_damaged": seen.bad_crc, "skipped_bytes": seen.skipped_bytes}
    if link.signing is not None:
        counts["frames_verified"] = link.signing.verified
        counts |= {f"refused_{why.replace(' ', '_')}": number for why, number in link.signing.refused.items()}
    return counts


_BEGIN_NS: Final = 1_600_000_000 * SECOND_NS
_UTC_NS: Final = _BEGIN_NS + SECOND_NS // 2  # from then on it says what UTC is
_END_NS: Final = _BEGIN_NS + 3 * SECOND_NS // 2
_BOOTED_NS: Final = 10 * SECOND_NS  # before it begins
_TICK_NS: Final = SECOND_NS // 20
_RATES_HZ: Final = {**DEFAULT_RATES_HZ, "GPS_RAW_INT": 5.0, "DISTANCE_SENSOR": 5.0, "TERRAIN_REPORT": 5.0}


def warm_up(station: StationConfig) -> None:
    """Fly a simulated vehicle for 1.5 s past the station's pipeline, with an image on every tick; nothing is kept.

    What is compiled, or read from where compiled functions are kept, is so before the service says that it runs: on the
    first run after an installation that took 5 s out of the first flight, in which images had no pose.
    """
    telemetry = station.pipeline.telemetry
    if telemetry is None:
        return
    any_vehicle = replace(telemetry, system=None, component=None, gimbal=None)
    pipeline = assembly.build_pipeline(replace(station, pipeline=replace(station.pipeline, telemetry=any_vehicle)))
    for batch in _flight():
        pipeline.advance(batch)
    pipeline.finish()


def _flight() -> Iterator[Batches]:
    """The ticks of a vehicle that sets off and turns its gimbal."""
    begin = Waypoint(
        time_s=0.0, east_m=0.0, north_m=0.0, height_m=30.0, heading_rad=0.0, gimbal_pitch_rad=math.radians(-70.0)
    )
    end = replace(begin, time_s=(_END_NS - _BEGIN_NS) / SECOND_NS, north_m=10.0, gimbal_pitch_rad=math.radians(-50.0))
    way = fly((begin, end), origin=GeoOrigin(lat_rad=0.8, lon_rad=0.1, alt_msl_m=0.0), start_ns=_BEGIN_NS)
    silent = Autopilot(rates_hz={**_RATES_HZ, "SYSTEM_TIME": 0.0}, booted_ns=_BOOTED_NS)
    telling = Autopilot(rates_hz=_RATES_HZ, booted_ns=_BOOTED_NS + _UTC_NS - _BEGIN_NS)
    sent = datagrams(way.cut(_BEGIN_NS, _UTC_NS), silent) + datagrams(way.cut(_UTC_NS, _END_NS), telling)
    for index, now_ns in enumerate(range(_BEGIN_NS, _END_NS, _TICK_NS)):
        received = [each for each in sent if now_ns - _TICK_NS < each.due_ns <= now_ns]
        block = block_of(WireProtocol.MAVLINK, "", [each.due_ns for each in received], [each.data for each in received])
        yield Batches.from_events(
            np.array([now_ns]), (block, Image(index=index, stamp_ns=now_ns, arrival_ns=now_ns, clock=StampClock.HOST))
        )
