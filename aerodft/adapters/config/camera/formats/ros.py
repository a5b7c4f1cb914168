"""ROS's camera_info: the YAML file of its camera calibration, or a CameraInfo message as `topic echo` prints it.

Pixels count from the centre of the top-left one; distortion is OpenCV's. The camera is that of the raw image, not of a
rectified one.
"""

import re
from typing import Any, Final

from aerodft.adapters.config.camera.formats.opencv import intrinsics_of_matrix
from aerodft.adapters.config.camera.formats.syntax import yaml_table
from aerodft.adapters.config.camera.formats.values import Values, camera_keys, refused_model
from aerodft.errors import ConfigError
from aerodft.model import LensModel

_MARK: Final = re.compile(r"^distortion_model\s*:", re.MULTILINE)
_MODELS: Final = {
    "plumb_bob": LensModel.BROWN,
    "rational_polynomial": LensModel.BROWN,
    "equidistant": LensModel.FISHEYE,
    "fisheye": LensModel.FISHEYE,
}


def recognises(text: str) -> bool:
    """Whether the text has a distortion model at its root."""
    return _MARK.search(text) is not None


def read(text: str) -> dict[str, Any]:
    """Keys of a camera file.

    Raises:
        ConfigError: A missing or impossible value, an unknown model, or an image that is binned or cropped.
    """
    values = Values(yaml_table(text))
    model = values.text("distortion_model")
    if model not in _MODELS:
        raise refused_model("distortion_model", model, _MODELS)
    _refuse_partial_image(values)
    size_px = (
        values.size_px(values.key_of("image_width", "width")),
        values.size_px(values.key_of("image_height", "height")),
    )
    matrix = intrinsics_of_matrix(values, values.key_of("camera_matrix", "K", "k"))
    distortion = values.key_of("distortion_coefficients", "D", "d")
    keys = camera_keys(size_px, matrix, _MODELS[model], values.numbers(distortion), distortion)
    name = values.text("camera_name", "")
    return {"name": name} | keys if name else keys


def _refuse_partial_image(values: Values) -> None:
    """Refuse images that are not the calibrated ones."""
    for key in ("binning_x", "binning_y"):
        if values.number(key, 0.0) > 1:
            raise ConfigError(key, got=f"{values.number(key):g}", expected="an image of all pixels")
    if "roi" in values:
        roi = values.table("roi")
        for key in ("x_offset", "y_offset"):
            if offset := roi.number(key, 0.0):
                raise ConfigError(roi.path(key), got=f"{offset:g}", expected="an image of all pixels")
