"""The images of a station that measures, as they come; and what is wrong with it, while that lasts."""

import math
import shutil
import threading
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import orjson

from aerodft.adapters.config.station import StationConfig, with_calibration
from aerodft.adapters.images import decode_jpeg, encode_jpeg
from aerodft.adapters.wire.measurement import measurement_payload
from aerodft.adapters.wire.status import UNMEASURED, StationStatus, encode_status
from aerodft.adapters.worker_queue import WorkerQueue
from aerodft.app.diagnose import diagnose_heard
from aerodft.app.viewing.view import Document, PoseFinder, Scene, View, ViewedImage, doctor_document
from aerodft.conventions import SECOND_NS
from aerodft.dft import zoomed
from aerodft.errors import AerodftError, NoAnswerError
from aerodft.model import (
    Camera,
    CameraMotionEstimate,
    Image,
    ImageArray,
    Measurement,
    MotionState,
    PoseBatch,
    PoseSample,
    RawBlock,
)
from aerodft.service import Batches, StepOutputs
from aerodft.service.pose import over_water

if TYPE_CHECKING:
    from aerodft.app.station import Station

_MOST_HZ: Final = 15.0
_IDLE_S: Final = 5.0
"""Nobody who looks asks less often."""
_QUEUED: Final = 2
_KEPT_PICTURES: Final = 48
"""Those of three seconds: an image waits for its telemetry for two."""
_KEPT_POSES: Final = 2000
"""A page that was paused minutes ago goes on measuring in its image."""
_KEPT_BLOCKS: Final = 500
"""Of telemetry, for doctor: of half a minute, or more."""
_JPEG_QUALITY: Final = 85
_LONGEST_S: Final = 3.0
"""Without an image; and how long without telemetry."""
_MOST_LOSS: Final = 0.1
_LEAST_FREE_BYTES: Final = 2_000_000_000
_UNMEASURED: Final = (
    ("load", ("dropped", "too_many"), "they come faster than this machine measures"),
    ("stream", ("damaged", "not_later"), "they came damaged, or twice"),
)
"""Alerts by the causes that they sum up; the ``unstamped`` first half second of a stream is none."""

Sentences = Iterator[tuple[str, str]]


class Alerts:
    """What is wrong now; used by the station's thread and by others."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._since_ns: dict[str, int] = {}
        self._sentences: dict[str, str] = {}
        self._motion: CameraMotionEstimate | None = None
        self._status: StationStatus | None = None
        self._image_s = time.monotonic()

    def take(self, batches: Batches, outputs: StepOutputs) -> None:
        """Take what came and what was made of it."""
        if len(batches.images):
            self._image_s = time.monotonic()
        for single in outputs.singles:
            if isinstance(single.content, CameraMotionEstimate):
                self._motion = single.content

    def status(self, value: StationStatus) -> None:
        """Take the station's state."""
        with self._lock:
            self._status = value

    def now(self, free_bytes: int) -> list[dict[str, Any]]:
        """What is wrong: a ``key``, ``since_ns`` (UTC, as text) and a ``text`` each.

        Args:
            free_bytes: On the disk of the recording.
        """
        with self._lock:
            found = dict(self._found(free_bytes))
            stamp_ns = 0 if self._status is None else self._status.stamp_ns
            self._since_ns = {key: self._since_ns.get(key, stamp_ns) for key in found}
            return [{"key": key, "since_ns": str(self._since_ns[key]), "text": text} for key, text in found.items()]

    def _found(self, free_bytes: int) -> Sentences:
        silent_s = time.monotonic() - self._image_s
        if silent_s > _LONGEST_S:
            yield "images", f"no image has come for {silent_s:.0f} s: is the stream still there?"
        if self._motion is not None and self._motion.state not in {MotionState.STEADY, MotionState.UNCHECKED}:
            turned_deg = math.degrees(math.hypot(*self._motion.turn_rad))
            yield "camera", f"the camera has moved ({self._motion.state}), by {turned_deg:.2f} deg: calibrate it anew"
        if free_bytes < _LEAST_FREE_BYTES:
            yield "room", f"only {free_bytes / 1e9:.1f} GB are left on the disk of the recording: make room"
        if self._status is not None:
            yield from _of_status(self._status)


def _of_status(status: StationStatus) -> Sentences:
    counts, health = status.counts, status.health
    gone = counts.get("shed_messages", 0) + counts.get("lost_messages", 0)
    images = counts.get("shed_images", 0) + counts.get("lost_images", 0)
    if gone or images:
        yield "disk", f"{gone} messages and {images} images are not recorded: the disk is too slow, full or failing"
    for key, causes, why in _UNMEASURED:
        if images := sum(counts.get(f"{UNMEASURED}{cause}", 0) for cause in causes):
            yield key, f"{images} images were not measured: {why}"
    if health is None:
        return
    if health.heartbeat_age_s is None or health.heartbeat_age_s > _LONGEST_S:
        since = "yet" if health.heartbeat_age_s is None else f"for {health.heartbeat_age_s:.0f} s"
        yield "telemetry", f"the autopilot has not been heard {since}: check the link"
    elif health.loss_share > _MOST_LOSS:
        yield "link", f"{100 * health.loss_share:.0f} % of the telemetry is lost on its way"
    stale = [name for name, age_s in health.ages_s.items() if math.isfinite(age_s) and age_s > _LONGEST_S]
    if stale and health.heartbeat_age_s is not None and health.heartbeat_age_s <= _LONGEST_S:
        named = ", ".join(f"{name} for {health.ages_s[name]:.0f} s" for name in sorted(stale))
        yield "stale", f"telemetry has stopped: {named}"


@dataclass(slots=True)
class _LiveImage:
    """An image that is shown once its picture is encoded and its pose is known."""

    stamp_ns: int
    has_picture: bool
    jpeg: bytes | None = None
    sample: PoseSample | None = None

    @property
    def is_ready(self) -> bool:
        return self.sample is not None and (self.jpeg is not None or not self.has_picture)


class LiveView(View):
    """The newest images of a station, each with its pose; their numbers are those of the station.

    An output of the station that never makes it wait: pictures are encoded in a thread of their own, 15 a second at
    most and only while somebody asks; those that come while two wait are left out.

    Args:
        station: The station, to which this is added as an output before it is entered.

    Attributes:
        newest: Number of the newest image that can be shown; -1 before the first.
    """

    def __init__(self, station: "Station") -> None:
        config, file = station.config, station.file
        self._settings = config.pipeline
        self._setup = config.pipeline.setup
        self._recording = station.recording.absolute()
        self.station_file = file
        if file is not None and config.fixed_pose is not None:
            calibration = file.with_name(f"{file.stem}-calibration.toml")
            self.finder = PoseFinder(self.camera, calibration, partial(_fixed_scene, config))
        self._lock = threading.Lock()
        self._images: OrderedDict[int, _LiveImage] = OrderedDict()
        self._measured: dict[str, Measurement] = {}
        self._heard: deque[RawBlock] = deque(maxlen=_KEPT_BLOCKS)
        self._status: StationStatus | None = None
        self._alerts = Alerts()
        self._asked_s = -_IDLE_S
        self._last_ns: int | None = None
        self._listeners: set[Callable[[], object]] = set()
        self._queue: WorkerQueue[Image] = WorkerQueue("page-images", self._encode, capacity=_QUEUED)
        self.newest = -1

    @property
    def title(self) -> str:
        """The station's name."""
        return self._settings.station

    @property
    def camera(self) -> Camera:
        """The station's."""
        return self._setup.camera

    @property
    def images(self) -> Sequence[ViewedImage]:
        """None: they come as they are asked for."""
        return ()

    @contextmanager
    def heard_by(self, listener: Callable[[], object]) -> Iterator[None]:
        """While the block lasts, have a function called when there is a new image; it must not block."""
        self._listeners.add(listener)
        try:
            yield
        finally:
            self._listeners.discard(listener)

    def news(self) -> Document:
        """What is newest, and whether anything is wrong.

        Returns:
            ``image``: ``number``, ``stamp_ns``, ``has_picture`` and what ``seen`` says; None before the first one.
            ``status``: the station's, as published. ``alerts``: what is wrong, see ``Alerts``. ``disk``: that of the
            recording, with its ``free_bytes``.
        """
        self._asked_s = time.monotonic()
        with self._lock:
            number, status = self.newest, self._status
            shown = self._images.get(number)
        image: Document | None = None
        if shown is not None:
            image = {"number": number, "stamp_ns": str(shown.stamp_ns), "has_picture": shown.has_picture}
            image |= self.seen(number)
        state = None if status is None else orjson.loads(encode_status(status))
        free_bytes = self._free_bytes()
        alerts = self._alerts.now(free_bytes)
        return {"image": image, "status": state, "alerts": alerts, "disk": {"free_bytes": free_bytes}}

    def doctor(self) -> Document | None:
        """See ``View``: of the last half minute."""
        settings = self._settings
        return None if settings.telemetry is None else doctor_document(diagnose_heard(tuple(self._heard), settings))

    def measured(self, number: int) -> list[Document]:
        """See ``View``: of every probe the newest."""
        del number
        with self._lock:
            newest = list(self._measured.values())
        return [measurement_payload(each) for each in newest]

    def jpeg(self, number: int) -> bytes:
        """See ``View``."""
        jpeg = self._image(number).jpeg
        if jpeg is None:
            raise self._gone(number)
        return jpeg

    def pixels(self, number: int) -> ImageArray:
        """See ``View``; as they were encoded."""
        return decode_jpeg(self.jpeg(number), f"image {number}", None)

    def scene(self, number: int) -> Scene:
        """See ``View``."""
        sample = self._image(number).sample
        if sample is None:
            raise self._gone(number)
        if self.finder is not None and self.finder.scene is not None:
            setup, fixed = self.finder.scene
            fixed = replace(fixed, stamp_ns=sample.stamp_ns)
            return setup, over_water(PoseBatch.from_samples([fixed]), self._settings.level)[0]
        setup, sample = zoomed(self._setup, sample)
        return setup, replace(sample, zoom=None)

    def options(self, number: int) -> dict[str, str]:
        """See ``View``: of the recording that is being made."""
        used = None if self.finder is None else self.finder.used_file
        named = {} if used is None else {"calibration": str(used)}
        return {"recording": str(self._recording), "at": str(self.scene(number)[1].stamp_ns), **named}

    def take(self, batches: Batches, outputs: StepOutputs) -> None:
        """See ``Sink``."""
        self._alerts.take(batches, outputs)
        self._heard.extend(batches.raw)
        if time.monotonic() - self._asked_s > _IDLE_S:
            return
        for image in batches.images:
            if self._is_due(image):
                self._last_ns = image.arrival_ns
                self._keep(image)
        with self._lock:
            for block in outputs.images:
                for row, number in enumerate(block.images.tolist()):
                    if number in self._images:
                        self._images[number].sample = block.poses[row]
                        self._images[number].stamp_ns = int(block.poses.stamp_ns[row])
                        self._show(number)
            for _, _, batch in outputs.measured():
                if len(batch):
                    self._measured |= {each.name: each for each in batch[len(batch) - 1]}

    def status(self, value: StationStatus) -> None:
        """Take the station's state."""
        self._status = value
        self._alerts.status(value)

    def warnings(self) -> tuple[str, ...]:
        """None: what a page did not get is in the recording."""
        return ()

    def close(self) -> None:
        """End the thread that encodes."""
        self._queue.close()

    def _free_bytes(self) -> int:
        folder = self._recording
        return shutil.disk_usage(next(each for each in (folder, *folder.parents) if each.exists())).free

    def _is_due(self, image: Image) -> bool:
        return self._last_ns is None or image.arrival_ns - self._last_ns >= 0.9 * SECOND_NS / _MOST_HZ

    def _keep(self, image: Image) -> None:
        """Remember an image, if there is room for it to be encoded."""
        has_picture = image.pixels is not None
        with self._lock:
            self._images[image.index] = _LiveImage(image.stamp_ns, has_picture)
        if has_picture and not self._queue.put(image):
            with self._lock:
                self._images.pop(image.index)
            return
        with self._lock:
            numbers = list(self._images)
            for number in numbers[:-_KEPT_POSES]:
                self._images.pop(number)
            for number in numbers[-_KEPT_PICTURES - 1 : -_KEPT_PICTURES]:
                self._images[number].jpeg = None

    def _encode(self, image: Image) -> None:
        try:
            jpeg = encode_jpeg(image, _JPEG_QUALITY)
        except AerodftError:  # damaged on its way: the next one is shown
            return
        with self._lock:
            if image.index in self._images:
                self._images[image.index].jpeg = jpeg
                self._show(image.index)

    def _show(self, number: int) -> None:
        if number > self.newest and self._images[number].is_ready:
            self.newest = number
            for listener in tuple(self._listeners):
                listener()

    def _image(self, number: int) -> _LiveImage:
        with self._lock:
            found = self._images.get(number)
        if found is None:
            raise self._gone(number)
        return found

    def _gone(self, number: int) -> NoAnswerError:
        hint = f"`aerodft view {self._recording}` shows it once the station has ended"
        return NoAnswerError("the image is no longer kept", where=self.title, got=f"image {number}", hint=hint)


def _fixed_scene(config: StationConfig, file: Path) -> Scene:
    """Camera, ground and pose of a fixed camera with a calibration file."""
    pipeline = with_calibration(config, file).pipeline
    if pipeline.fixed_pose is None:
        raise NoAnswerError("no fixed camera", where=file)
    return pipeline.setup, pipeline.fixed_pose
