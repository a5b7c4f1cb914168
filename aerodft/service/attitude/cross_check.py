"""Gimbal sources held against each other: how far two attitudes of one camera are apart, and what that may be."""

import math
from typing import Final, NamedTuple

import numpy as np

from aerodft.geometry import inverse, multiply, to_rotation_vector
from aerodft.model import BoolArray, FloatArray
from aerodft.service.attitude.readings import AttitudeBatch
from aerodft.service.settings import DEMAND_TILT_STD_RAD, AttitudeSettings

CONTRADICTION_STDS: Final = 5.0
"""Combined standard deviations beyond which two sources contradict each other; by chance once in 1.7 million."""

_MIN_STD_RAD: Final = math.radians(
    0.5
)  # chosen: two messages of one gimbal are sampled up to 0.1 s apart while it turns
_MIN_HEADING_STD_RAD: Final = math.radians(2)  # chosen: messages of one heading come up to 0.2 s apart while it turns
_NOTABLE_STDS: Final = 1.0  # a smaller difference is what the stds say; from there on the std covers it


def heading_doubts(difference_rad: FloatArray, settings: AttitudeSettings) -> FloatArray:
    """Standard deviations ``(n,)`` that cover both of two headings; 0 where they differ by no more than their stds.

    Args:
        difference_rad: ``(n,)`` of two headings of the vehicle, any number of turns apart; NaN where there is but one.
        settings: The standard deviation of one.
    """
    apart_rad = np.abs((difference_rad + math.pi) % (2 * math.pi) - math.pi)
    combined_rad = math.sqrt(2) * max(settings.std.heading_rad, _MIN_HEADING_STD_RAD)
    return np.where(apart_rad > _NOTABLE_STDS * combined_rad, apart_rad, 0.0)


class SourceDifference(NamedTuple):
    """Two gimbal sources at ``n`` stamps.

    Attributes:
        rotation_rad: ``(n, 3)`` from the first one's camera to the second one's, in the first one's camera axes.
        is_contradiction: ``(n,)`` whether no standard deviations explain it.
        is_notable: ``(n,)`` whether it is more than the standard deviations.
    """

    rotation_rad: FloatArray
    is_contradiction: BoolArray
    is_notable: BoolArray


def source_difference(first: AttitudeBatch, second: AttitudeBatch, settings: AttitudeSettings) -> SourceDifference:
    """How far two sources' attitudes ``(n,)`` are apart; both have one at all stamps."""
    rotation_rad = np.asarray(to_rotation_vector(multiply(inverse(first.wxyz), second.wxyz)))
    variance = sum((_variance(each, settings) for each in (first, second)), np.zeros_like(rotation_rad))
    stds = np.sqrt(np.sum(rotation_rad**2 / variance, axis=-1))
    return SourceDifference(rotation_rad, stds > CONTRADICTION_STDS, stds > _NOTABLE_STDS)


def _variance(attitudes: AttitudeBatch, settings: AttitudeSettings) -> FloatArray:
    """Variances ``(n, 3)`` about the camera's axes; one source may have its yaw from the compass, another not."""
    std = settings.std
    is_demand = np.array([note.is_demand for note in attitudes.notes])[attitudes.note]
    tilt_rad = np.where(is_demand, max(std.tilt_rad, DEMAND_TILT_STD_RAD), std.tilt_rad)
    others = (np.full(len(tilt_rad), each) for each in (std.pan_rad, std.roll_rad, std.heading_rad))
    stated_rad = np.stack([tilt_rad, *others], axis=-1)
    stated_rad = np.where(np.isnan(attitudes.stated_std_rad), stated_rad, attitudes.stated_std_rad)
    across_rad = np.hypot(stated_rad[:, 1:3], stated_rad[:, 3:])
    axes_rad = np.concatenate([stated_rad[:, :1], across_rad], axis=-1)
    return np.asarray(np.maximum(axes_rad, _MIN_STD_RAD) ** 2 + attitudes.report_std_rad**2)
