"""An image or a video of a fixed camera, with a pose that is stated, or found from landmarks."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import tomli_w

from aerodft.adapters.images import STILLS, SeekableVideo, read_camera_image, refuse_other_size
from aerodft.app.calibrate import CalibrationResult, calibrate
from aerodft.app.measure import MeasuredSurface, image_setup
from aerodft.app.viewing.overlay import scene_overlay
from aerodft.app.viewing.view import Document, View, ViewedImage
from aerodft.conventions import SECOND_NS
from aerodft.dft import Setup
from aerodft.errors import AerodftError, NoAnswerError
from aerodft.model import Camera, ImageArray, PoseSample
from aerodft.reports.calibration import Mark, rows_of

Scene = tuple[Setup, PoseSample]


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

    def __init__(
        self, path: Path, camera: Camera, scene: Scene | None, options: Mapping[str, str], surface: MeasuredSurface
    ) -> None:
        self._path = path
        self._camera = camera
        self._scene = scene
        self._options = dict(options)
        self._surface = surface
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
        if self._scene is None:
            hint = "place landmarks to find it, or state `height` and `tilt`"
            raise NoAnswerError("the camera's pose is not known yet", where=self._path, hint=hint)
        return self._scene

    def seen(self, number: int) -> Document:
        """See ``View``; before the pose is known it is None."""
        self._check(number)
        return {"pose": None, "measurements": []} if self._scene is None else super().seen(number)

    def options(self, number: int) -> dict[str, str]:
        """See ``View``."""
        self._check(number)
        return self._options

    @property
    def can_calibrate(self) -> bool:
        """See ``View``."""
        return True

    def calibrate(self, evidence: Document, unknowns: Sequence[str], *, use: bool) -> Document:
        """See ``View``."""
        found = self._found(evidence, unknowns)
        document = found.document(is_saved=use)
        document["marks"] = [_mark_document(row.mark) for row in rows_of(found.fit)]
        if use:
            file = self._path.with_name(f"{self._path.stem}-calibration.toml")
            found.save(file)
            self._scene = self._calibrated(file)
            kept = {name: value for name, value in self._options.items() if name == "camera"}
            self._options = kept | {"calibration": str(file)}
            document["file"] = str(file)
        if found.refusal(is_saved=True) is None:
            with TemporaryDirectory() as folder:
                found.save(file := Path(folder) / "calibration.toml")
                document["overlay"] = scene_overlay(*self._calibrated(file))
        return document

    def _found(self, evidence: Document, unknowns: Sequence[str]) -> CalibrationResult:
        with TemporaryDirectory() as folder:
            file = Path(folder) / "evidence.toml"
            file.write_bytes(tomli_w.dumps(evidence).encode())
            try:
                return calibrate(file, self._camera, unknowns)
            except AerodftError as error:
                hint, got, expected = error.hint, error.got, error.expected
                raise type(error)(error.what, where="what was marked", got=got, expected=expected, hint=hint) from None

    def _calibrated(self, file: Path) -> Scene:
        return image_setup(self._camera, None, calibration=file, surface=self._surface)

    def _check(self, number: int) -> None:
        if not 0 <= number < len(self._media_ns):
            expected = f"0 to {len(self._media_ns) - 1}"
            raise NoAnswerError("no such image", where=self._path, got=number, expected=expected)


def _mark_document(mark: Mark) -> Document:
    """An observation by its name, with its pixels and where the calibrated camera sees them, None where it does not."""
    pixels = {"seen_px": mark.seen_px, "expected_px": mark.expected_px}
    found = {key: [None if np.isnan(each).any() else each.tolist() for each in rows] for key, rows in pixels.items()}
    return {"name": mark.name, "kind": mark.kind, **found}
