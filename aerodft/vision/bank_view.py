"""What stands on a bank and is seen from behind hides water: how much of it, by the view's geometry alone."""

from typing import Final

import numpy as np

from aerodft.model.arrays import FloatArray
from aerodft.model.pose import Pose

ONE_SIDED: Final = 0.5
"""Metres of water hidden by a metre of growth, from which a width is a bound from below."""


def hidden_per_metre(pose: Pose, banks_enu_m: FloatArray) -> FloatArray:
    """Length of a transect that each metre of height on its banks hides.

    A bank between the camera and the water hides what is behind it; the opposite one hides none.

    Args:
        pose: Of the camera.
        banks_enu_m: ``(n, 2, 3)`` the two ends of each transect.

    Returns:
        ``(n, 2)``, 0 where the bank is seen from the water's side.
    """
    outward = (banks_enu_m - banks_enu_m[:, ::-1])[..., :2]
    with np.errstate(invalid="ignore", divide="ignore"):
        outward = outward / np.linalg.norm(outward, axis=-1, keepdims=True)
    away = banks_enu_m - pose.position_enu_m
    toward_water = -np.sum(outward * away[..., :2], axis=-1)
    return np.asarray(np.maximum(toward_water / -away[..., 2], 0.0))
