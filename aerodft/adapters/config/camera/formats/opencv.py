"""A camera matrix and distortion coefficients as OpenCV's FileStorage, or a script around OpenCV, writes them.

YAML, XML or JSON. Pixels count from the centre of the top-left one.
"""

import re
from typing import Any, Final
from xml.etree import ElementTree as ET

from aerodft.adapters.config.camera.formats.syntax import json_table, xml_root, yaml_table
from aerodft.adapters.config.camera.formats.values import Values, camera_keys
from aerodft.errors import ConfigError
from aerodft.geometry import LENS_MODELS, Lens
from aerodft.model import LensModel

_MATRIX: Final = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "CameraMatrix", "K", "mtx")
_DISTORTION: Final = (
    "distortion_coefficients",
    "distCoeffs",
    "Distortion_Coefficients",
    "DistCoeffs",
    "dist_coeffs",
    "dist_coeff",
    "dist",
    "D",
)
_WIDTH: Final = ("image_width", "image_Width", "imageWidth", "width")
_HEIGHT: Final = ("image_height", "image_Height", "imageHeight", "height")
_NAMES: Final = "|".join(_MATRIX)
_MARK: Final = re.compile(rf"^(?:{_NAMES})\s*:|[{{,]\s*\"(?:{_NAMES})\"\s*:|<opencv_storage>", re.MULTILINE)
_PLANE_ROW: Final = (0.0, 0.0, 1.0)


def recognises(text: str) -> bool:
    """Whether the text has a camera matrix at its root, or is OpenCV's XML."""
    return _MARK.search(text) is not None


def read(text: str) -> dict[str, Any]:
    """Keys of a camera file.

    Raises:
        ConfigError: A missing or impossible value.
    """
    start = text.lstrip()[:1]
    values = Values(
        json_table(text) if start == "{" else _xml_table(xml_root(text)) if start == "<" else yaml_table(text)
    )
    width, height = values.key_of(*_WIDTH), values.key_of(*_HEIGHT)
    for key in (width, height):
        if key not in values:
            expected = "the size of the calibrated images"
            raise ConfigError(key, got="nothing", expected=expected, hint=f"add {key} to the file")
    lens = _lens_of(values)
    distortion = values.key_of(*_DISTORTION)
    named = [values.number(name) for name in lens.model.coefficients if name == lens.opencv_key]  # beside the others
    matrix = intrinsics_of_matrix(values, values.key_of(*_MATRIX))
    size_px = values.size_px(width), values.size_px(height)
    return camera_keys(size_px, matrix, lens.model, (*named, *values.numbers(distortion)), distortion)


def _lens_of(values: Values) -> Lens:
    """The model that the file marks; Brown's where it marks none."""
    marked = (each for each in LENS_MODELS.values() if each.opencv_key and values.number(each.opencv_key, 0.0))
    return next(marked, LENS_MODELS[LensModel.BROWN])


def intrinsics_of_matrix(values: Values, key: str) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy of a 3 x 3 camera matrix.

    Raises:
        ConfigError: No such matrix, or one with a skew.
    """
    fx, skew, cx, other, fy, cy, *last = values.numbers(key, 9)
    if skew or other or tuple(last) != _PLANE_ROW:
        raise ConfigError(
            values.path(key), got="a skew, or rows of another matrix", expected="[fx 0 cx, 0 fy cy, 0 0 1]"
        )
    if min(fx, fy) <= 0:
        raise ConfigError(values.path(key), got=f"a focal length of {min(fx, fy):g} px", expected="more than 0")
    return fx, fy, cx, cy


def _xml_table(root: ET.Element) -> dict[str, Any]:
    """Elements of OpenCV's XML as the same table that its YAML is."""
    return {
        each.tag: {"data": (each.findtext("data") or "").split()} if each.find("data") is not None else each.text
        for each in root
    }
