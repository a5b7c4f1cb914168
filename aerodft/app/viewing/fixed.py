"""An image or a video of a fixed camera, with a pose that is stated, or found from landmarks."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path

from aerodft.adapters.images import STILLS, SeekableVideo, read_camera_image, refuse_other_size
from aerodft.app.measure import MeasuredSurface, image_setup
from aerodft.app.viewing.view import Document, PoseFinder, Scene, View, ViewedImage
from aerodft.conventions import SECOND_NS
from aerodft.errors import NoAnswerError
from aerodft.model import Camera, ImageArray


class FixedCameraView(View):
    """One image, or those of a video, of a camera that does not move.

    Args:
        path: The image or video, of the camera's size.
        camera: The camera.
        scene: Camera, ground and pose; None where the pose is not known yet.
        options: Those of the command line that say camera and pose, by their names.
        surface: What is measured.

    Raises:
        InputError: The file cannot be read, or is not of the camera.
    """

    finder: PoseFinder

    def __init__(
        self, path: Path, camera: Camera, scene: Scene | None, options: Mapping[str, str], surface: MeasuredSurface
    ) -> None:
        self._path = path
        self._camera = camera
        self._options = dict(options)
        self.finder = PoseFinder(
            camera,
            path.with_name(f"{path.stem}-calibration.toml"),
            lambda file: image_setup(camera, None, calibration=file, surface=surface),
            scene,
        )
        if path.suffix.lower() in STILLS:
            pixels = read_camera_image(path, camera, "the camera file must be of the image's mode")
            self._pixels: Callable[[int], ImageArray] = lambda _: pixels
            self._media_ns = [0]
        else:
            video = SeekableVideo(path)
            refuse_other_size((video.info.width_px, video.info.height_px), camera, path)
            self._pixels, self._media_ns = video.pixels, video.media_ns

    @property
    def title(self) -> str:
        """The file's name."""
        return self._path.name

    @property
    def camera(self) -> Camera:
        """The camera as it was given; what a calibration finds of its lens is in the scene."""
        return self._camera

    @cached_property
    def images(self) -> Sequence[ViewedImage]:
        """Those of the file; when they were taken nobody knows."""
        return tuple(ViewedImage(stamp_ns=0, seconds=media_ns / SECOND_NS) for media_ns in self._media_ns)

    def pixels(self, number: int) -> ImageArray:
        """See ``View``."""
        self._check(number)
        return self._pixels(number)

    def scene(self, number: int) -> Scene:
        """See ``View``.

        Raises:
            NoAnswerError: There is no such image, or no pose yet.
        """
        self._check(number)
        if self.finder.scene is None:
            raise NoAnswerError("the camera's pose is not known yet", hint="mark what is known of the view")
        return self.finder.scene

    def seen(self, number: int) -> Document:
        """See ``View``; before the pose is known it is None."""
        self._check(number)
        return super().seen(number) if self.finder.scene else {"pose": None, "measurements": []}

    def options(self, number: int) -> dict[str, str]:
        """See ``View``."""
        self._check(number)
        if self.finder.used_file is None:
            return self._options
        camera = {name: value for name, value in self._options.items() if name == "camera"}
        return camera | {"calibration": str(self.finder.used_file)}

    def _check(self, number: int) -> None:
        if not 0 <= number < len(self._media_ns):
            expected = f"0 to {len(self._media_ns) - 1}"
            raise NoAnswerError("no such image", where=self._path, got=number, expected=expected)
