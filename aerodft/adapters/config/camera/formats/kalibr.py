"""Kalibr's camchain: pinhole cameras with radtan (OpenCV's Brown) or equidistant (OpenCV's fisheye) distortion.

Pixels count from the centre of the top-left one.
"""

import re
from typing import Any, Final

from aerodft.adapters.config.camera.formats.syntax import yaml_table
from aerodft.adapters.config.camera.formats.values import camera_keys, only_table, refused_model
from aerodft.errors import ConfigError
from aerodft.model import LensModel

_MARK: Final = re.compile(r"^cam\d+\s*:", re.MULTILINE)
_CAMERA: Final = re.compile(r"cam\d+")
_PINHOLE: Final = "pinhole"
_MODELS: Final = {"radtan": LensModel.BROWN, "equidistant": LensModel.FISHEYE, "none": LensModel.BROWN}


def recognises(text: str) -> bool:
    """Whether the text has cameras by Kalibr's names at its root."""
    return _MARK.search(text) is not None and "camera_model" in text


def read(text: str) -> dict[str, Any]:
    """Keys of a camera file.

    Raises:
        ConfigError: Several cameras, a missing or impossible value, or an unknown model.
    """
    values = only_table({key: each for key, each in yaml_table(text).items() if _CAMERA.fullmatch(key)})
    if (camera := values.text("camera_model")) != _PINHOLE:
        raise refused_model(values.path("camera_model"), camera, [_PINHOLE])
    if (model := values.text("distortion_model")) not in _MODELS:
        raise refused_model(values.path("distortion_model"), model, _MODELS)
    width, height = values.numbers("resolution", 2)
    if not (min(width, height) > 0 and width.is_integer() and height.is_integer()):
        raise ConfigError(values.path("resolution"), got=f"{width:g} x {height:g}", expected="whole pixels")
    fx, fy, cx, cy = values.numbers("intrinsics", 4)
    if min(fx, fy) <= 0:
        raise ConfigError(
            values.path("intrinsics"), got=f"a focal length of {min(fx, fy):g} px", expected="more than 0"
        )
    distortion = () if model == "none" else values.numbers("distortion_coeffs", 4)
    size_px = int(width), int(height)
    return camera_keys(size_px, (fx, fy, cx, cy), _MODELS[model], distortion, values.path("distortion_coeffs"))
