"""The images of a recording, with the poses that its telemetry gives them."""

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from threading import Lock
from typing import Final

from aerodft.adapters.wire.events import IMAGE_SCHEMA, decode_images
from aerodft.app.diagnose import diagnose
from aerodft.app.recorded_scenes import RecordedScenes
from aerodft.app.recordings import StationRecording
from aerodft.app.viewing.view import Document, View, ViewedImage, doctor_document
from aerodft.conventions import SECOND_NS
from aerodft.dft import Setup
from aerodft.errors import NoAnswerError, located
from aerodft.model import Camera, Image, ImageArray, PoseSample
from aerodft.reports.recording_series import Series, read_series
from replay.export import parse_measurement
from replay.recordings import PixelStore, measurements_of

_KEPT_SCENES: Final = 64


class RecordingView(View):
    """The images of a recording, with the poses that its telemetry gives them.

    Args:
        recording: Made by a station.

    Raises:
        NoAnswerError: No image was recorded.
        InputError: The recording is damaged.
    """

    def __init__(self, recording: StationRecording) -> None:
        self._recording = recording
        store, reader = PixelStore(recording.reader), recording.reader
        payloads = [message.data for message in reader.messages(wanted=lambda each: each.schema == IMAGE_SCHEMA)]
        found = [(image, store.pixels(image)) for image in decode_images(payloads)] if len(store) else []
        self._images = sorted(
            ((image, pixels) for image, pixels in found if pixels is not None), key=lambda each: each[0].stamp_ns
        )
        if not self._images:
            hint = "record.image_hz says how many are recorded"
            raise NoAnswerError("the recording holds no image", where=recording.path, hint=hint)
        self._decoding = Lock()  # a video is decoded in order, for whoever asks
        self._scenes = RecordedScenes(recording.path, reader)
        self._scene = lru_cache(maxsize=_KEPT_SCENES)(lambda number: self._scenes.of(self._images[number][0]))

    @property
    def title(self) -> str:
        """The station's name."""
        return self._recording.station

    @property
    def camera(self) -> Camera:
        """The station's."""
        return self._scenes.setup.camera

    @cached_property
    def images(self) -> Sequence[ViewedImage]:
        """Those whose pixels were recorded."""
        zero_ns = self._recording.reader.zero_ns
        return tuple(
            ViewedImage(stamp_ns=image.stamp_ns, seconds=(image.stamp_ns - zero_ns) / SECOND_NS)
            for image, _ in self._images
        )

    def pixels(self, number: int) -> ImageArray:
        """See ``View``."""
        self._image(number)
        with self._decoding:
            return self._images[number][1]()

    def scene(self, number: int) -> tuple[Setup, PoseSample]:
        """See ``View``."""
        self._image(number)
        return self._scene(number)

    def measured(self, number: int) -> list[Document]:
        """See ``View``."""
        with located(self._recording.path):
            return [
                dict(parse_measurement(each)) for each in measurements_of(self._recording.reader, self._image(number))
            ]

    def series(self) -> Document:
        """What was measured and known over time, for plots.

        Returns:
            ``probes``: ``name``, ``kind``, ``unit``, ``seconds``, ``value``, ``low``, ``high``, ``status`` of each;
            ``poses``: ``seconds``, ``height_m``, ``tilt_deg`` with their stds, ``height_source``,
            ``telemetry_age_s``, ``status``, the track's ``east_m`` and ``north_m``; ``events``: ``seconds``, ``kind``
            and ``text`` of each. None for what is not known.

        Raises:
            InputError: The recording is damaged.
        """
        found = read_series(self._recording.reader)
        zero_ns = found.zero_ns
        poses = found.poses
        columns = ("height_m", "height_std_m", "tilt_deg", "tilt_std_deg", "telemetry_age_s", "east_m", "north_m")
        return {
            "probes": [
                {
                    "name": each.name,
                    "kind": each.kind,
                    "unit": each.unit,
                    "seconds": _seconds(each, zero_ns),
                    "value": _numbers(each, "value"),
                    "low": _numbers(each, "ci95_low"),
                    "high": _numbers(each, "ci95_high"),
                    "status": each.statuses,
                }
                for each in found.probes.values()
            ],
            "poses": {
                "seconds": _seconds(poses, zero_ns),
                **{name: _numbers(poses, name) for name in columns},
                "height_source": poses.texts["height_source"],
                "status": poses.statuses,
            },
            "events": [
                {"seconds": (each.stamp_ns - zero_ns) / SECOND_NS, "kind": each.kind, "text": each.text}
                for each in found.events
            ],
        }

    def doctor(self) -> Document:
        """See ``View``."""
        return doctor_document(diagnose(self._recording.path))

    def options(self, number: int) -> dict[str, str]:
        """See ``View``."""
        return {"recording": str(self._recording.path.absolute()), "at": str(self.scene(number)[1].stamp_ns)}

    def _image(self, number: int) -> Image:
        if not 0 <= number < len(self._images):
            expected = f"0 to {len(self._images) - 1}"
            raise NoAnswerError("no such image", where=self._recording.path, got=number, expected=expected)
        return self._images[number][0]


def _seconds(series: Series, zero_ns: int) -> list[float]:
    return [(stamp_ns - zero_ns) / SECOND_NS for stamp_ns in series.stamps_ns]


def _numbers(series: Series, name: str) -> list[float | None]:
    return [None if math.isnan(each) else each for each in series.columns[name]]
