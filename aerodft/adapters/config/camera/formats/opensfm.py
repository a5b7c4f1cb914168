"""OpenSfM's and OpenDroneMap's cameras.json.

Lengths are in the image's larger side, from the image's centre, which is at ((w - 1) / 2, (h - 1) / 2) px.
Distortion is OpenCV's, by its names.
"""

import re
from collections.abc import Mapping
from typing import Any, Final

from aerodft.adapters.config.camera.formats.syntax import json_value
from aerodft.adapters.config.camera.formats.values import (
    Values,
    camera_keys,
    named_distortion,
    only_table,
    refused_model,
)
from aerodft.errors import ConfigError
from aerodft.model import LensModel

_MARK: Final = re.compile(r"\"projection_type\"\s*:")
_MODELS: Final = {
    "perspective": (LensModel.BROWN, ("k1", "k2")),
    "simple_radial": (LensModel.BROWN, ("k1",)),
    "radial": (LensModel.BROWN, ("k1", "k2")),
    "brown": (LensModel.BROWN, ("k1", "k2", "p1", "p2", "k3")),
    "fisheye": (LensModel.FISHEYE, ("k1", "k2")),
    "fisheye_opencv": (LensModel.FISHEYE, ("k1", "k2", "k3", "k4")),
}


def recognises(text: str) -> bool:
    """Whether the text is JSON with a projection type in it."""
    return text.lstrip()[:1] in {"{", "["} and _MARK.search(text) is not None


def read(text: str) -> dict[str, Any]:
    """Keys of a camera file.

    Raises:
        ConfigError: Several cameras, a missing or impossible value, or an unknown model.
    """
    values = _camera(json_value(text))
    model = values.text("projection_type")
    if model not in _MODELS:
        raise refused_model(values.path("projection_type"), model, _MODELS)
    lens, names = _MODELS[model]
    width, height = values.size_px("width"), values.size_px("height")
    larger_px = max(width, height)
    matrix = (
        larger_px * values.positive(values.key_of("focal_x", "focal")),
        larger_px * values.positive(values.key_of("focal_y", "focal_x", "focal")),
        (width - 1) / 2 + larger_px * values.number("c_x", 0.0),
        (height - 1) / 2 + larger_px * values.number("c_y", 0.0),
    )
    distortion = named_distortion(lens, {name: values.number(name, 0.0) for name in names})
    return camera_keys((width, height), matrix, lens, distortion, values.path("k1"))


def _camera(document: object) -> Values:
    """The camera of cameras.json, of a camera alone, or of a reconstruction."""
    if isinstance(document, list) and document:
        document = document[0]
    if not isinstance(document, Mapping):
        raise ConfigError("holds no keys", got="JSON without a table", expected="cameras by their names")
    if "projection_type" in document:
        return Values(document)
    cameras = document.get("cameras", document)
    return only_table(cameras if isinstance(cameras, Mapping) else {})
