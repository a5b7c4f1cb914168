"""Telemetry's biases to a calibration file, as ``calibration.load_calibration`` reads it."""

from pathlib import Path
from typing import Any

import tomli_w

from aerodft.adapters.config.bias_tables import bias_document
from aerodft.adapters.config.calibration_file import write_whole
from aerodft.adapters.config.camera import camera_document
from aerodft.errors import InputError
from aerodft.model.calibration import Calibration
from aerodft.model.camera import Camera
from aerodft.model.measurement import ProjectionModel


def write_biases(
    path: Path, found: Calibration, camera: Camera | None, model: ProjectionModel, provenance: dict[str, Any]
) -> None:
    """Write what telemetry is off by.

    Args:
        path: The TOML file; one that is there is replaced.
        found: The biases.
        camera: The camera where its lens was found too; None where it was taken as it is.
        model: The projection model that it is of, and for.
        provenance: Where all this comes from, for people; what is None is left out.

    Raises:
        InputError: The file cannot be written.
    """
    document: dict[str, Any] = {
        "model": str(model),
        "provenance": {key: value for key, value in provenance.items() if value is not None},
        "bias": bias_document(found),
    }
    if camera is not None:
        document["camera"] = camera_document(camera)
    try:
        write_whole(path, tomli_w.dumps(document).encode())
    except OSError as error:
        what, expected = "the calibration cannot be written", "a file to write to"
        raise InputError(what, where=path, got=error.strerror, expected=expected) from error
