"""What stated standard deviations of telemetry mean for many images: a part that all share, and a part that is new."""

import math
from collections.abc import Sequence

import numpy as np

from aerodft.model.arrays import FloatArray
from aerodft.model.evidence import Prior
from aerodft.model.pose import PoseStd
from aerodft.service.settings import ErrorStd
from calibration.live_model import excess

_OWN = ("horizontal_m", "horizontal_m", "height_agl_m", "tilt_rad", "pan_rad", "roll_rad", "heading_rad")
_SHARED = {
    "height": "height_agl_m",
    "tilt": "tilt_rad",
    "roll": "roll_rad",
    "heading": "heading_rad",
    "pan": "pan_rad",
    "east": "horizontal_m",
    "north": "horizontal_m",
}


def shared_and_new(
    stds: Sequence[PoseStd], share: float, noise: ErrorStd
) -> tuple[dict[str, Prior], tuple[FloatArray, ...]]:
    """Priors of the biases by name, and for each image the standard deviations ``(7,)`` of what is new in it.

    As in a live calibration: most of what is stated is one error for the whole flight. What an image is stated to be
    worse than the best one is new in it.

    Args:
        stds: As stated of each image.
        share: Of each, what is new in every image.
        noise: The same for single errors, in their own units.
    """
    best = {name: min(getattr(std, name) for std in stds) for name in set(_OWN)}
    shared = math.sqrt(1 - share**2)
    priors = {bias: Prior(value=0.0, std=shared * best[name]) for bias, name in _SHARED.items()}
    stated = {name: getattr(noise, "height_m" if name == "height_agl_m" else name) for name in best}
    least = {name: share * best[name] if given is None else given for name, given in stated.items()}
    return priors, tuple(
        np.array([math.hypot(least[name], excess(getattr(std, name), best[name])) for name in _OWN]) for std in stds
    )


def typical_noise(noises: Sequence[FloatArray]) -> PoseStd:
    """What is new in an image of which nobody says more: the middle of what was stated."""
    east, _, height, tilt, pan, roll, heading = np.median(noises, axis=0).tolist()
    return PoseStd(
        height_agl_m=height, horizontal_m=east, tilt_rad=tilt, pan_rad=pan, roll_rad=roll, heading_rad=heading
    )
