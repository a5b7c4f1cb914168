"""The messages of a recording that viewers know: Foxglove's protobuf schemas."""

import math

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from google.protobuf.timestamp_pb2 import Timestamp

from aerodft.model import Camera, Image, LensModel, PoseSample, VideoPacket

_BROWN_COEFFICIENTS = 5


def compressed_image(image: Image, jpeg: bytes, frame: str) -> bytes:
    """A JPEG at the image's stamp as ``foxglove.CompressedImage``."""
    message = CompressedImage(timestamp=_timestamp(image.stamp_ns), frame_id=frame, data=jpeg, format="jpeg")
    return bytes(message.SerializeToString())


def compressed_video(packet: VideoPacket, frame: str) -> bytes:
    """An image of an H.264 stream at its stamp as ``foxglove.CompressedVideo``."""
    stamp = _timestamp(packet.stamp_ns)
    message = CompressedVideo(timestamp=stamp, frame_id=frame, data=packet.data, format="h264")
    return bytes(message.SerializeToString())


def camera_calibration(camera: Camera, stamp_ns: int) -> bytes:
    """A camera as ``foxglove.CameraCalibration`` (OpenCV's distortion models)."""
    if camera.lens is LensModel.FISHEYE:
        model, coefficients = "fisheye_opencv", camera.distortion
    else:
        model = "rational_polynomial" if len(camera.distortion) > _BROWN_COEFFICIENTS else "plumb_bob"
        coefficients = camera.distortion + (0.0,) * (_BROWN_COEFFICIENTS - len(camera.distortion))
    matrix = (camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0)
    message = CameraCalibration(
        timestamp=_timestamp(stamp_ns),
        frame_id=camera.name,
        width=camera.width_px,
        height=camera.height_px,
        distortion_model=model,
        D=coefficients,
        K=matrix,
        R=np.eye(3).ravel(),
        P=(*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0),
    )
    return bytes(message.SerializeToString())


def location_fix(sample: PoseSample, frame: str) -> bytes | None:
    """Where the camera is as ``foxglove.LocationFix``, altitude above mean sea level; None without a position."""
    lat_rad, lon_rad, alt_msl_m = sample.lat_lon_alt
    if lat_rad is None or lon_rad is None:
        return None
    message = LocationFix(
        timestamp=_timestamp(sample.stamp_ns),
        frame_id=frame,
        latitude=math.degrees(lat_rad),
        longitude=math.degrees(lon_rad),
        altitude=math.nan if alt_msl_m is None else alt_msl_m,
    )
    if sample.cov is not None:
        message.position_covariance.extend(sample.cov[:3, :3].ravel().tolist())
        message.position_covariance_type = LocationFix.KNOWN
    return bytes(message.SerializeToString())


def _timestamp(stamp_ns: int) -> Timestamp:
    return Timestamp(seconds=stamp_ns // 1_000_000_000, nanos=stamp_ns % 1_000_000_000)
