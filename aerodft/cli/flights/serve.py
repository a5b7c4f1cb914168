"""``aerodft serve``: MAVLink and images in, measurements out on zenoh and into a recording, until it is stopped."""

import gc
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer

from aerodft.adapters.config.station import Device, Rate, StationConfig, Stills, Stream, VideoFile, load_station
from aerodft.adapters.images import LiveRate, StreamReader
from aerodft.adapters.outputs import Output, open_outputs
from aerodft.adapters.recording.write import McapRecorder
from aerodft.adapters.telemetry import signing_sentences
from aerodft.adapters.telemetry.mavlink import MavlinkLink, parse_address
from aerodft.adapters.wire.status import StationStatus
from aerodft.app.assembly import (
    RunStatistics,
    build_observers,
    build_pipeline,
    build_recorder,
    check_size,
    opened_signing,
    outputs_run,
    run,
)
from aerodft.app.recordings import recovering_beside
from aerodft.cli.flight import DEFAULT_RATE_HZ
from aerodft.cli.option_values import MOST_SECONDS
from aerodft.cli.output import say
from aerodft.cli.rehearsal import rehearse
from aerodft.cli.summary import report
from aerodft.conventions import SECOND_NS
from aerodft.errors import ConfigError, InputError
from aerodft.model import Image, VideoPacket
from aerodft.service import Inbox, LiveFeed, LiveObservers, Pipeline
from aerodft.service.clocks import WallClock


def serve(
    config: Annotated[Path, typer.Argument(help="Station configuration (TOML).")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="New folder for the recording; else one under record.folder.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(min=0.0, max=MOST_SECONDS, help="Stop after this time.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON at the end.")] = False,
) -> None:
    r"""Measure live until SIGINT or SIGTERM: every configured probe, for every image.

    \b
    Example:
      aerodft serve configs/services/river-flight.toml
    """
    station = load_station(config)
    settings = station.pipeline
    if settings.telemetry is not None and station.link is None:
        raise ConfigError("telemetry.connection", where=config, got="none", expected='e.g. "udpin:127.0.0.1:14550"')
    clock, statistics, pipeline = WallClock(), RunStatistics(), build_pipeline(station)
    pipeline.warm_up()
    rehearse(station)
    eyes = build_observers(station, pipeline, config)
    inbox = Inbox(clock)
    feed = LiveFeed(inbox, clock, settings.tick_ns)
    folder = output or station.record.folder / _folder_name(settings.station, clock.now_ns())
    with ExitStack() as stack:
        started_ns = clock.now_ns()
        stack.enter_context(recovering_beside(station.record.folder))  # what a kill or a power cut left unfinished
        outputs = stack.enter_context(open_outputs(station.outputs, outputs_run(station, pipeline, inbox)))
        look = stack.enter_context(LiveObservers(eyes.schedules, inbox.put_observations))
        images = _ImageGate(station, inbox, feed, look, where=config)
        packets = _PacketGate()
        link = _open_inputs(station, inbox, images, packets, clock, stack)
        recorder = build_recorder(station, folder, started_ns=started_ns, lossless=False)  # once nothing can fail
        stack.callback(recorder.close)
        packets.recorder = recorder
        stack.enter_context(_stop_on_signal(feed, seconds))
        gc.freeze()  # else each full search among 100,000 loaded objects holds everything up for 0.05 to 0.12 s
        say(f"recording to {folder}; stop with Ctrl-C")
        receivers: tuple[McapRecorder | Output, ...] = (*outputs, recorder)
        status = _status_every_second(station, pipeline, inbox, look, statistics, receivers, recorder, link)
        run(feed, pipeline, (*receivers, statistics), status)
    images.raise_refusal()
    for sentence in (each for output in outputs for each in output.warnings()):
        say(sentence)
    seen = eyes.report(look.counts)
    warnings = tuple(signing_sentences(link.signing)) if link is not None and link.signing is not None else ()
    report(recorder.totals, statistics, pipeline.counts, as_json=json, warnings=warnings, live=True, seen=seen)


def _folder_name(station: str, now_ns: int) -> str:
    return f"{station}-{datetime.fromtimestamp(now_ns // SECOND_NS, UTC):%Y%m%d-%H%M%S}"


def _open_inputs(
    station: StationConfig,
    inbox: Inbox,
    images: "_ImageGate",
    packets: "_PacketGate",
    clock: WallClock,
    stack: ExitStack,
) -> MavlinkLink | None:
    """Open the MAVLink link, if there is one, and the image source; both leave what they receive in the inbox."""
    source, offset_s = station.images.source, station.image_offset_s
    if isinstance(source, Stream | Device):
        url = source.url if isinstance(source, Stream) else source.path
        stack.enter_context(StreamReader(url, images, clock=clock, on_packet=packets, time_offset_s=offset_s))
    else:
        rate = LiveRate(source.rate_hz if isinstance(source, Rate) else DEFAULT_RATE_HZ, inbox.put_image, clock)
        rate.start()
        stack.callback(rate.stop)
    if station.link is None or station.pipeline.telemetry is None:
        return None
    check = stack.enter_context(opened_signing(station.link.signing))
    address = parse_address(station.link.connection, baud=station.link.baud)
    return stack.enter_context(MavlinkLink(address, inbox, signing=check))


class _PacketGate:
    """Passes video to the recorder, once there is one."""

    def __init__(self) -> None:
        self.recorder: McapRecorder | None = None

    def __call__(self, packet: VideoPacket) -> None:
        if self.recorder is not None:
            self.recorder.packet(packet)


class _ImageGate:
    """Passes images to the inbox and to who looks at them; one of another size than the camera's ends the service."""

    def __init__(
        self, station: StationConfig, inbox: Inbox, feed: LiveFeed, look: LiveObservers, *, where: Path
    ) -> None:
        source = station.images.source
        if isinstance(source, VideoFile | Stills):
            raise ConfigError(
                "images", where=where, got="recorded images", expected="stream, device or rate_hz", hint="use import"
            )
        self._camera = station.pipeline.camera
        self._inbox = inbox
        self._feed = feed
        self._look = look
        self._refusal: InputError | None = None

    def __call__(self, image: Image) -> None:
        try:
            check_size(image, self._camera, "image stream")
        except InputError as refusal:
            self._refusal = refusal
            self._feed.stop()
        else:
            self._inbox.put_image(image)
            self._look(image)

    def raise_refusal(self) -> None:
        """Say why the service ended by itself, if it did.

        Raises:
            InputError: An image was of the wrong size.
        """
        if self._refusal is not None:
            raise self._refusal


def _status_every_second(
    station: StationConfig,
    pipeline: Pipeline,
    inbox: Inbox,
    look: LiveObservers,
    statistics: RunStatistics,
    receivers: Sequence[McapRecorder | Output],
    recorder: McapRecorder,
    link: MavlinkLink | None,
) -> Callable[[int], None]:
    """What publishes and records the station's state once a second of ticks, called with the time of each."""
    next_ns = 0

    def tell(now_ns: int) -> None:
        nonlocal next_ns
        if now_ns < next_ns:
            return
        next_ns = now_ns + SECOND_NS
        counts = {
            "images": statistics.images,
            "dropped_images": inbox.dropped_images,
            "looks": sum(each.looked for each in look.counts),
            "skipped_looks": sum(each.skipped for each in look.counts),
            **({} if link is None else _link_counts(link)),
            **recorder.totals.counts,
            **{f"poses_{status}": number for status, number in statistics.poses.items()},
            **{f"measurements_{status}": number for status, number in statistics.measurements.items()},
        }
        last = pipeline.last_pose
        status = StationStatus(
            station=station.pipeline.station,
            stamp_ns=now_ns,
            state="running",
            text="no image yet" if last is None else "; ".join((str(last.status), *last.reasons)),
            counts=counts,
            health=pipeline.health(now_ns),
            rejected=pipeline.rejected(),
        )
        for receiver in receivers:
            receiver.status(status)

    return tell


def _link_counts(link: MavlinkLink) -> dict[str, int]:
    """What the link has heard, let in and refused."""
    seen = link.counts
    counts = {"frames": seen.frames, "frames_damaged": seen.bad_crc, "skipped_bytes": seen.skipped_bytes}
    if link.signing is not None:
        counts["frames_verified"] = link.signing.verified
        counts |= {f"refused_{why.replace(' ', '_')}": number for why, number in link.signing.refused.items()}
    return counts


@contextmanager
def _stop_on_signal(feed: LiveFeed, seconds: float | None) -> Iterator[None]:
    """End the feed on SIGINT, SIGTERM, or after some seconds."""

    def stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - a signal handler's signature
        feed.stop()

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    timer = threading.Timer(seconds, feed.stop) if seconds is not None else None
    if timer is not None:
        timer.start()
    try:
        yield
    finally:
        if timer is not None:
            timer.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)
