"""The images of a recording, with the poses that its telemetry gives them."""

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Final

from aerodft.adapters.wire.events import IMAGE_SCHEMA, decode_images
from aerodft.app.measure import RecordedScenes
from aerodft.app.recordings import StationRecording
from aerodft.app.viewing.view import View, ViewedImage
from aerodft.conventions import SECOND_NS
from aerodft.dft import Setup
from aerodft.errors import NoAnswerError
from aerodft.model import Camera, Image, ImageArray, PoseSample
from replay.recordings import PixelStore

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
        start_ns = self._recording.start_ns
        return tuple(
            ViewedImage(stamp_ns=image.stamp_ns, seconds=(image.stamp_ns - start_ns) / SECOND_NS)
            for image, _ in self._images
        )

    def pixels(self, number: int) -> ImageArray:
        """See ``View``."""
        self._image(number)
        return self._images[number][1]()

    def scene(self, number: int) -> tuple[Setup, PoseSample]:
        """See ``View``."""
        self._image(number)
        return self._scene(number)

    def options(self, number: int) -> dict[str, str]:
        """See ``View``."""
        return {"recording": str(self._recording.path), "at": str(self.scene(number)[1].stamp_ns)}

    def _image(self, number: int) -> Image:
        if not 0 <= number < len(self._images):
            expected = f"0 to {len(self._images) - 1}"
            raise NoAnswerError("no such image", where=self._recording.path, got=number, expected=expected)
        return self._images[number][0]
