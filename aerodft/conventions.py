"""Frames, axes, signs, units, pixel centre, quaternion order and clocks: the one page that decides them.

Every statement below has a test in ``tests/test_conventions.py``.

Units
    Radians, metres, seconds of float or nanoseconds of int inside; degrees, degE7, millimetres and centidegrees end
    in ``adapters``, ``configs`` and ``cli``. Names carry unit and frame: ``tilt_rad``, ``points_enu_m``. No quantity
    from outside is larger than ``LARGEST`` in its unit, so that squares and products of them stay finite.

Heights
    ``_agl_m`` above the measured (ground or water) plane of the stamp, ``_home_m`` above the take-off point, ``_msl_m``
    above mean sea level, ``_ellipsoid_m`` above WGS84.

Pixels
    (u, v), u right, v down; (0, 0) is the centre of the top-left pixel, the image spans -0.5 to W - 0.5.
    The ``dft`` model alone uses the paper's W/2, H/2.

Camera axes
    x right, y down, z forward (OpenCV). Body axes: x front, y right, z down.

Angles
    Tilt: between the optical axis and straight down; 0 nadir, 90 degrees horizon. MAVLink's gimbal pitch is 0 at the
    horizon and negative downwards, so tilt = 90 degrees + pitch. Roll: right-handed about the optical axis, positive
    with the camera's right side down. Heading: clockwise from true north.

Frames
    ENU: x east, y north, z up, origin fixed on the measured plane; where the water's level changes, at the station's
    elevation 0. In memory a pose's up counts from the water at its stamp, so that the measured plane is always z = 0;
    published ups and altitudes count from elevation 0. NED: x north, y east, z down, in MAVLink handling.
    Ground frame: origin on the plane straight below the camera, X right, Y ahead (the horizontal projection of the
    optical axis; at nadir of the image's up direction), Z up.
    ``dst_SO3_src`` and ``dst_SE3_src`` take points in ``src`` and return points in ``dst``.

Quaternions
    Components w, x, y, z; Hamilton product; ``q`` and ``-q`` are the same rotation.

Covariance of a pose
    6 x 6: position in ENU (m), then a small rotation in camera axes (rad), applied on the right:
    ``R(true) = R(estimated) exp(delta)``. Never Euler angles: they are singular at nadir, the main view of a river.

Clocks
    Stamps are int nanoseconds of UTC. ``arrival_ns`` is this machine's time, ``boot_ns`` the vehicle's since power-on.
"""

import math
from typing import Final

SECOND_NS: Final = 1_000_000_000
"""Nanoseconds in a second."""

LARGEST: Final = 1e12
"""Numbers from files, options and the bus are refused beyond it."""

PIXEL_CENTRE_OFFSET_PX: Final = 0.5
"""The image's border lies this far outside the centres of its outermost pixels."""

GIMBAL_SO3_CAM_WXYZ: Final = (0.5, 0.5, 0.5, 0.5)
"""Camera axes (right, down, forward) in gimbal axes (forward, right, down)."""

ENU_SO3_NED_WXYZ: Final = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)
"""NED axes in ENU; its own inverse."""

NADIR_TILT_RAD: Final = 1e-9
"""Below this tilt the optical axis has no horizontal projection, and the image's up direction is ahead."""
