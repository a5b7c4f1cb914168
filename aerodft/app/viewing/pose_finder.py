"""The pose of a camera that does not move, from what people know of its view."""

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
import tomli_w

from aerodft.app.viewing.overlay import scene_overlay
from aerodft.dft import Setup
from aerodft.errors import AerodftError
from aerodft.model import Camera, PoseSample

if TYPE_CHECKING:
    from aerodft.app.calibrate import CalibrationResult
    from aerodft.reports.calibration import Mark

Scene: TypeAlias = tuple[Setup, PoseSample]

_MARKED: Final = "what was marked"


class PoseFinder:
    """Finds the pose of a camera that does not move, and keeps the one that people chose to measure with.

    Args:
        camera: The camera.
        file: Where a calibration is written that is measured with.
        scene_with: Camera, ground and pose with a calibration file.
        scene: Those that are known before; None where they are not.

    Attributes:
        scene: Camera, ground and pose that are measured with.
        used_file: The calibration file that they are of; None before one was chosen.
    """

    def __init__(
        self, camera: Camera, file: Path, scene_with: Callable[[Path], Scene], scene: Scene | None = None
    ) -> None:
        self._camera = camera
        self._file = file.absolute()
        self._scene_with = scene_with
        self.scene = scene
        self.used_file: Path | None = None

    def calibrate(
        self, evidence: dict[str, Any], unknowns: Sequence[str], *, accept: bool, use: bool
    ) -> dict[str, Any]:
        """Find the pose; arguments, result and errors as those of ``View.calibrate``."""
        from aerodft.reports.calibration import rows_of  # slow to load, see ``_found``

        with TemporaryDirectory() as folder:
            marked, file = Path(folder) / "evidence.toml", Path(folder) / "calibration.toml"
            marked.write_bytes(tomli_w.dumps(evidence).encode())
            found = self._found(marked, unknowns, accept=accept)
            document = found.document(is_saved=True)
            document["reasons"] = [each.replace(str(marked), _MARKED) for each in document["reasons"]]
            document["marks"] = [_mark_document(row.mark) for row in rows_of(found.fit)]
            if found.refusal(is_saved=True) is None:
                found.save(file)
                document |= {
                    "file_text": file.read_text(encoding="utf-8"),
                    "overlay": scene_overlay(*self._scene_with(file)),
                }
                if use:
                    document["file"] = str(self._use(found))
        return document

    def _found(self, marked: Path, unknowns: Sequence[str], *, accept: bool) -> "CalibrationResult":
        from aerodft.app.calibrate import calibrate  # slow to load, and most pages find no pose

        try:
            return calibrate(marked, self._camera, unknowns, accept_misfit=accept, check=False)
        except AerodftError as error:
            hint, got, expected = error.hint, error.got, error.expected
            raise type(error)(error.what, where=_MARKED, got=got, expected=expected, hint=hint) from None

    def _use(self, found: "CalibrationResult") -> Path:
        """Write a calibration, and measure with it from now on."""
        found.save(self._file)
        self.scene, self.used_file = self._scene_with(self._file), self._file
        return self._file


def _mark_document(mark: "Mark") -> dict[str, Any]:
    """An observation by its name, with its pixels and where the calibrated camera sees them, None where it does not."""
    pixels = {"seen_px": mark.seen_px, "expected_px": mark.expected_px}
    found = {key: [None if np.isnan(each).any() else each.tolist() for each in rows] for key, rows in pixels.items()}
    return {"name": mark.name, "kind": mark.kind, **found}
