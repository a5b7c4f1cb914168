"""A camera out of the calibration message that another tool recorded with its images."""

from typing import Any

import orjson
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from google.protobuf.message import DecodeError

from aerodft.adapters import bounded_json
from aerodft.adapters.foreign.fields import Fields
from aerodft.adapters.foreign.kinds import JSON, PROTOBUF, ROS1, type_of
from aerodft.adapters.mcap.places import ReadChannel
from aerodft.model.camera import Camera, LensModel

_BROWN = {"plumb_bob": 5, "rational_polynomial": 8, "": 0}
_MOST = 100  # numbers that are looked at: megabytes of them are four times as much as a tuple
_FISHEYE = {"fisheye_opencv", "kannala_brandt", "equidistant", "fisheye"}


def read_camera(channel: ReadChannel, data: bytes) -> Camera:
    """The camera of one message; what it does not say (how well all this is known) is 0.

    Raises:
        ValueError: There is none in it, or one with another model of the lens.
    """
    try:
        values = _values(channel, data)
        width_px, height_px, model, distortion, matrix = values
        return _camera(channel.topic, int(width_px), int(height_px), str(model), tuple(distortion), tuple(matrix))
    except (DecodeError, orjson.JSONDecodeError, KeyError, TypeError, IndexError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error


def _values(channel: ReadChannel, data: bytes) -> tuple[Any, ...]:
    """Width, height, model, distortion, matrix."""
    if channel.encoding == PROTOBUF:
        message = CameraCalibration.FromString(data)
        return message.width, message.height, message.distortion_model, message.D[:_MOST], message.K[:_MOST]
    if channel.encoding == JSON:
        item = bounded_json.loads(data)
        matrix = item.get("K") or item.get("k") or []
        return item["width"], item["height"], item.get("distortion_model", ""), item.get("D") or item.get("d"), matrix
    fields = Fields(data, is_ros1=channel.encoding == ROS1)
    if type_of(channel.schema)[0] == "sensor_msgs":
        fields.header_ns()
        height_px, width_px = fields.integer(), fields.integer()
    else:
        fields.time_ns(), fields.text()
        width_px, height_px = fields.integer(), fields.integer()
    return width_px, height_px, fields.text(), fields.floats(), fields.floats(9)


def _camera(
    name: str, width_px: int, height_px: int, model: str, distortion: tuple[float, ...], matrix: tuple[float, ...]
) -> Camera:
    fx_px, _, cx_px, _, fy_px, cy_px, *_ = matrix
    if model in _FISHEYE:
        lens, coefficients = LensModel.FISHEYE, distortion[:4]
    elif model in _BROWN:
        lens, coefficients = LensModel.BROWN, distortion[: _BROWN[model]]
    else:
        raise ValueError(f"lens model {model!r}")
    if not any(coefficients):
        coefficients = ()
    return Camera(
        name=name,
        width_px=width_px,
        height_px=height_px,
        fx_px=fx_px,
        fy_px=fy_px,
        cx_px=cx_px,
        cy_px=cy_px,
        lens=lens,
        distortion=coefficients,
    )
