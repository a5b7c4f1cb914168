"""Quaternions ``wxyz (..., 4)``, rotation matrices, and the camera's tilt, roll and heading."""

import numpy as np
import numpy.typing as npt

from aerodft.conventions import ENU_SO3_NED_WXYZ, GIMBAL_SO3_CAM_WXYZ, NADIR_TILT_RAD
from aerodft.model import FloatArray


def multiply(a_wxyz: FloatArray, b_wxyz: FloatArray) -> FloatArray:
    """Hamilton product ``a b`` (``b`` is applied first) of quaternions ``(..., 4)``, broadcast."""
    aw, ax, ay, az = _columns(a_wxyz)
    bw, bx, by, bz = _columns(b_wxyz)
    w = aw * bw - ax * bx - ay * by - az * bz
    product = np.empty((*w.shape, 4))
    product[..., 0] = w
    product[..., 1] = aw * bx + ax * bw + ay * bz - az * by
    product[..., 2] = aw * by - ax * bz + ay * bw + az * bx
    product[..., 3] = aw * bz + ax * by - ay * bx + az * bw
    return product


def _columns(rows: FloatArray) -> list[FloatArray]:
    """Components of ``(..., k)``, each ``(...)``; those of one row as scalars, which are quicker than arrays of one."""
    rows = np.asarray(rows, dtype=np.float64)
    return [rows[..., column][()] for column in range(rows.shape[-1])]


def inverse(wxyz: FloatArray) -> FloatArray:
    """The inverse of unit quaternions ``(..., 4)``."""
    return np.asarray(np.asarray(wxyz) * np.array([1.0, -1.0, -1.0, -1.0]))


def matrix(wxyz: FloatArray) -> FloatArray:
    """Rotation matrices ``(..., 3, 3)`` of unit quaternions ``(..., 4)``."""
    w, x, y, z = _columns(wxyz)
    m = np.empty((*w.shape, 3, 3))
    m[..., 0, 0], m[..., 0, 1], m[..., 0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    m[..., 1, 0], m[..., 1, 1], m[..., 1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    m[..., 2, 0], m[..., 2, 1], m[..., 2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return m


def from_rotation_vector(rotvec_rad: FloatArray) -> FloatArray:
    """Unit quaternions ``(..., 4)`` of rotation vectors ``(..., 3)`` (axis times angle)."""
    rotvec_rad = np.asarray(rotvec_rad, dtype=np.float64)
    angle = _length(rotvec_rad)
    scale = 0.5 * np.sinc(angle / (2 * np.pi))  # sin(angle/2)/angle, regular at 0
    return np.concatenate([np.cos(angle / 2), rotvec_rad * scale], axis=-1)


def to_rotation_vector(wxyz: FloatArray) -> FloatArray:
    """Rotation vectors ``(..., 3)`` of unit quaternions ``(..., 4)``, the shorter way round."""
    wxyz = np.asarray(wxyz, dtype=np.float64)
    wxyz = np.where(wxyz[..., :1] < 0, -wxyz, wxyz)
    sine = _length(wxyz[..., 1:])
    angle = 2 * np.arctan2(sine, wxyz[..., :1])
    tiny = sine < np.finfo(np.float64).tiny  # no direction left: the limit of angle over sine is 2
    scale = np.where(tiny, 2.0, angle / np.where(tiny, 1.0, sine))
    return wxyz[..., 1:] * scale


def _length(vectors: FloatArray) -> FloatArray:
    """Norms ``(..., 1)`` of vectors ``(..., 3)``: bit-identical to numpy's in a third of its time."""
    x, y, z = _columns(vectors)
    return np.asarray(np.sqrt(x * x + y * y + z * z))[..., None]


def slerp(a_wxyz: FloatArray, b_wxyz: FloatArray, weight: npt.ArrayLike) -> FloatArray:
    """Spherical interpolation from ``a`` (weight 0) to ``b`` (weight 1), the shorter way round."""
    step = to_rotation_vector(multiply(inverse(a_wxyz), b_wxyz))
    return multiply(a_wxyz, from_rotation_vector(step * np.asarray(weight)[..., None]))


def about_axis(axis: int, angle_rad: npt.ArrayLike) -> FloatArray:
    """Quaternions ``(..., 4)`` of rotations by angles about the x, y or z axis (0, 1, 2)."""
    half = np.asarray(angle_rad, dtype=np.float64) / 2
    wxyz = np.zeros((*half.shape, 4))
    wxyz[..., 0], wxyz[..., 1 + axis] = np.cos(half), np.sin(half)
    return wxyz


def from_yaw_pitch_roll(yaw_rad: npt.ArrayLike, pitch_rad: npt.ArrayLike, roll_rad: npt.ArrayLike) -> FloatArray:
    """Aerospace ZYX angles to quaternions ``(..., 4)``: yaw about z first, then pitch about y, then roll about x.

    The result turns body axes (front, right, down) into the reference's (north, east, down).
    """
    yaw, pitch, roll = np.broadcast_arrays(
        np.asarray(yaw_rad, dtype=np.float64), np.asarray(pitch_rad), np.asarray(roll_rad)
    )
    cy, sy, cp, sp, cr, sr = (f(a / 2) for a in (yaw, pitch, roll) for f in (np.cos, np.sin))
    return np.stack(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ],
        axis=-1,
    )


def yaw_pitch_roll(wxyz: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Aerospace ZYX angles (rad) of quaternions ``(..., 4)``; at pitch +-90 degrees roll is 0, yaw takes it."""
    m = matrix(wxyz)
    pitch = np.arcsin(np.clip(-m[..., 2, 0], -1.0, 1.0))
    regular = np.hypot(m[..., 2, 1], m[..., 2, 2]) > NADIR_TILT_RAD
    yaw = np.where(regular, np.arctan2(m[..., 1, 0], m[..., 0, 0]), np.arctan2(-m[..., 0, 1], m[..., 1, 1]))
    roll = np.where(regular, np.arctan2(m[..., 2, 1], m[..., 2, 2]), 0.0)
    return yaw, pitch, roll


def camera_attitude(tilt_rad: npt.ArrayLike, roll_rad: npt.ArrayLike, heading_rad: npt.ArrayLike) -> FloatArray:
    """``enu_SO3_cam`` quaternions ``(..., 4)`` from the camera's angles (see ``conventions``), broadcast."""
    tilt, roll, heading = (np.asarray(angle, dtype=np.float64) for angle in (tilt_rad, roll_rad, heading_rad))
    # Product of rotations by the heading (vertical), by pi - tilt (camera x) and by the roll (optical axis).
    sine, cosine, more, less = np.sin(tilt / 2), np.cos(tilt / 2), (heading + roll) / 2, (heading - roll) / 2
    w = -sine * np.cos(less)
    wxyz = np.empty((*w.shape, 4))
    wxyz[..., 0], wxyz[..., 1] = w, cosine * np.cos(more)
    wxyz[..., 2], wxyz[..., 3] = -cosine * np.sin(more), sine * np.sin(less)
    return wxyz


def camera_angles(enu_wxyz_cam: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Tilt in [0, pi], roll in (-pi, pi], heading in [0, 2 pi) of ``enu_SO3_cam``, each ``(...)`` in rad.

    At nadir (and zenith) roll is 0 and the heading is that of the image's up direction.
    """
    return angles_of_matrix(matrix(enu_wxyz_cam))


def angles_of_matrix(enu_r_cam: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Tilt, roll and heading of rotation matrices ``(..., 3, 3)``; ranges as in ``camera_angles``."""
    m = enu_r_cam
    axis = m[..., :, 2]
    horizontal = np.hypot(axis[..., 0], axis[..., 1])
    tilt = np.arctan2(horizontal, -axis[..., 2])
    ahead = np.where((horizontal > NADIR_TILT_RAD)[..., None], axis[..., :2], -m[..., :2, 1])
    heading = np.arctan2(ahead[..., 0], ahead[..., 1]) % (2 * np.pi)
    # The right axis, along that of the same camera without roll and along its image's down direction.
    (east, north, up), sine, cosine = (m[..., row, 0] for row in range(3)), np.sin(heading), np.cos(heading)
    down = -np.cos(tilt) * (sine * east + cosine * north) - np.sin(tilt) * up
    roll = np.arctan2(down, cosine * east - sine * north)
    return tilt, roll, heading


def camera_from_gimbal(ned_wxyz_gimbal: FloatArray) -> FloatArray:
    """``enu_SO3_cam`` of a camera that looks along the gimbal's x axis, from ``ned_SO3_gimbal``, ``(..., 4)``."""
    enu_wxyz_gimbal = multiply(np.array(ENU_SO3_NED_WXYZ), ned_wxyz_gimbal)
    return multiply(enu_wxyz_gimbal, np.array(GIMBAL_SO3_CAM_WXYZ))


def gimbal_from_camera(enu_wxyz_cam: FloatArray) -> FloatArray:
    """``ned_SO3_gimbal`` of a gimbal whose camera looks along its x axis, from ``enu_SO3_cam``, ``(..., 4)``."""
    ned_wxyz_cam = multiply(inverse(np.array(ENU_SO3_NED_WXYZ)), enu_wxyz_cam)
    return multiply(ned_wxyz_cam, inverse(np.array(GIMBAL_SO3_CAM_WXYZ)))


def rotate(rotations: FloatArray, vectors: FloatArray) -> FloatArray:
    """Rotated vectors ``(..., 3)`` by ``rotations (..., 3, 3)``, broadcast; bit-identical in any batch."""
    x, y, z = _columns(vectors)
    rotated = np.empty((*np.broadcast_shapes(rotations.shape[:-2], x.shape), 3))
    for row in range(3):
        rotated[..., row] = rotations[..., row, 0] * x + rotations[..., row, 1] * y + rotations[..., row, 2] * z
    return rotated


def cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """Cross product ``one x other`` of single vectors ``(3,)``, in a fifth of numpy's time."""
    (a, b, c), (x, y, z) = one.tolist(), other.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def skew(vectors: FloatArray) -> FloatArray:
    """Cross-product matrices ``(..., 3, 3)`` of ``(..., 3)``: ``skew(a) b = a x b``."""
    x, y, z = _columns(vectors)
    m = np.zeros((*x.shape, 3, 3))
    m[..., 0, 1], m[..., 0, 2], m[..., 1, 2] = -z, y, -x
    m[..., 1, 0], m[..., 2, 0], m[..., 2, 1] = z, -y, x
    return m


def right_jacobian(rotvec_rad: FloatArray) -> FloatArray:
    """Right Jacobian of SO(3), ``(..., 3, 3)``: ``exp(v + d) = exp(v) exp(J d)``, small ``v``, third order."""
    cross = skew(rotvec_rad)
    return np.asarray(np.eye(3) - cross / 2 + cross @ cross / 6)
