"""The camera's angles of one attitude, in plain floats: the array form costs twenty times as much for a single one."""

import math

from aerodft.conventions import NADIR_TILT_RAD


def camera_angles_deg(w: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Tilt, roll, heading in degrees of a unit quaternion ``enu_SO3_cam``, as ``geometry.rotation.camera_angles``.

    At nadir and zenith the roll is 0 and the heading is that of the image's up direction.
    """
    axis_east, axis_north = 2 * (x * z + w * y), 2 * (y * z - w * x)
    horizontal = math.hypot(axis_east, axis_north)
    tilt_rad = math.atan2(horizontal, 2 * (x * x + y * y) - 1)
    if horizontal > NADIR_TILT_RAD:
        ahead_east, ahead_north = axis_east, axis_north
    else:
        ahead_east, ahead_north = 2 * (w * z - x * y), 2 * (x * x + z * z) - 1
    heading_rad = math.atan2(ahead_east, ahead_north) % math.tau
    right_east, right_north = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z)
    right_up = 2 * (x * z - w * y)
    sine, cosine = math.sin(heading_rad), math.cos(heading_rad)
    along_right = right_east * cosine - right_north * sine
    ahead = right_east * sine + right_north * cosine
    along_down = -ahead * math.cos(tilt_rad) - right_up * math.sin(tilt_rad)
    return math.degrees(tilt_rad), math.degrees(math.atan2(along_down, along_right)), math.degrees(heading_rad)
