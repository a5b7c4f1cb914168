"""Where exactly a bank is along a transect: from the image's own profile across it, with how well that tells it.

A profile is a step between two textures. Either side's mean and spread are taken where the profile surely is on that
side; then every place of the step gets its likelihood, the nearer to the mask's outline the more, and mean and standard
deviation over all places are the answer.
Neighbouring samples of a texture are alike: a likelihood counts each sample only as far as it is news.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from scipy.special import ndtr

from aerodft.model.arrays import BoolArray, FloatArray, ImageArray

_STEP_PX: Final = 0.5
_ASIDE_PX: Final = np.array([-6.0, -4.5, -3.0, -1.5, 0.0, 1.5, 3.0, 4.5, 6.0])  # parallel profiles, along the bank
_PLACE_PX: Final = 0.2
_NEAR_SHARE: Final = 0.35  # of the window: so well the step's place is known beforehand, one standard deviation
_BLUR_PX: Final = 0.55  # of a sharp image's edge: a pixel's own width, and the interpolation
_NOISE: Final = 1.0  # grey levels: no side is known to be smoother
_LEAST_SPREAD: Final = 0.02  # of the step: no side is known to be more even


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Steps between water and land.

    Attributes:
        pixels_px: ``(..., 2)``.
        std_px: ``(...)`` along the transect, from the profile.
        contrast: ``(...)`` distance of the two sides in standard deviations of a profile's sample.
        across_px: ``(..., 2)`` unit vectors in the image, from water to land along the transect.
    """

    pixels_px: FloatArray
    std_px: FloatArray
    contrast: FloatArray
    across_px: FloatArray


def locate_edges(
    image: ImageArray, near_px: FloatArray, across_px: FloatArray, along_px: FloatArray, window_px: FloatArray
) -> Edges:
    """Find the steps near pixels.

    Args:
        image: ``(height, width, 3)`` BGR.
        near_px: ``(n, 2)`` where they are about.
        across_px: ``(n, 2)`` unit vectors from water to land along the transects.
        along_px: ``(n, 2)`` unit vectors along the banks.
        window_px: ``(n,)`` how far from there the step may be; as much farther out is on its side surely.
            Where it is 0 nothing is looked for.
    """
    pixels, stds, contrasts = near_px.copy(), window_px.copy(), np.zeros(len(near_px))
    for half in np.unique(window_px[window_px > 0]).tolist():
        rows = np.flatnonzero(window_px == half)
        profiles = _profiles(image, near_px[rows], across_px[rows], along_px[rows], half)
        offsets, stds[rows], contrasts[rows] = _located(profiles, half)
        pixels[rows] += offsets[:, None] * across_px[rows]
    return Edges(pixels, stds, contrasts, across_px)


def _offsets(half: float) -> FloatArray:
    return np.arange(-2 * half, 2 * half + _STEP_PX / 2, _STEP_PX)


def _profiles(image: ImageArray, near: FloatArray, across: FloatArray, along: FloatArray, half: float) -> FloatArray:
    """Colours ``(n, lines, samples, 3)``."""
    lines = near[:, None, None] + _ASIDE_PX[:, None, None] * along[:, None, None]
    at = (lines + _offsets(half)[:, None] * across[:, None, None]).astype(np.float32)
    flat = np.ascontiguousarray(at.reshape(len(near), -1, 2))
    colours = cv2.remap(image, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(colours, dtype=np.float64).reshape(*at.shape[:-1], 3)


def _located(profiles: FloatArray, half: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Offset and standard deviation (px), and contrast, each ``(n,)``."""
    offsets = _offsets(half)
    wet, dry = offsets <= -half, offsets >= half
    profile = _steps(profiles, wet, dry)
    spread_wet, spread_dry = (np.sqrt(np.var(profile[:, side], axis=-1) + _LEAST_SPREAD**2) for side in (wet, dry))
    news = 1.0 / _alike(profile, wet, dry)
    places = np.arange(-half, half + _PLACE_PX / 2, _PLACE_PX)
    score = news * _likelihood(profile, offsets, places, spread_wet, spread_dry)
    score -= 0.5 * np.square(places / (_NEAR_SHARE * half))
    weight = np.exp(score - score.max(axis=-1, keepdims=True))
    weight /= weight.sum(axis=-1, keepdims=True)
    mean = weight @ places
    variance = weight @ places**2 - mean**2
    contrast = 1.0 / np.sqrt(0.5 * (spread_wet**2 + spread_dry**2))
    return mean, np.sqrt(np.maximum(variance, 0.0) + _PLACE_PX**2 / 12), contrast


def _steps(profiles: FloatArray, wet: BoolArray, dry: BoolArray) -> FloatArray:
    """Profiles ``(n, samples)`` in the colour direction that tells the sides apart best: 0 in the water, 1 on land."""
    sides = [profiles[:, :, side].reshape(len(profiles), -1, 3) for side in (wet, dry)]
    means = [side.mean(axis=1) for side in sides]
    centred = [side - mean[:, None] for side, mean in zip(sides, means, strict=True)]
    scatter = sum(np.swapaxes(side, 1, 2) @ side / side.shape[1] for side in centred) + _NOISE * np.eye(3)
    apart = means[1] - means[0]
    direction = np.linalg.solve(scatter, apart[..., None])[..., 0]
    length = np.maximum(np.sum(direction * apart, axis=-1), 1e-9)
    values = np.einsum("nltc,nc->nt", profiles, direction) / profiles.shape[1]
    zero = np.sum(means[0] * direction, axis=-1)
    return np.asarray((values - zero[:, None]) / length[:, None])


def _alike(profile: FloatArray, wet: BoolArray, dry: BoolArray) -> float:
    """How many neighbouring samples tell no more than one."""
    products, squares = 0.0, 0.0
    for side in (wet, dry):
        rest = profile[:, side] - profile[:, side].mean(axis=-1, keepdims=True)
        rest = rest / (rest.std(axis=-1, keepdims=True) + 1e-9)
        products += float(np.mean(rest[:, 1:] * rest[:, :-1]))
        squares += float(np.mean(rest * rest))
    share = min(max(products / max(squares, 1e-9), 0.0), 0.98)
    return (1.0 + share) / (1.0 - share)


def _likelihood(
    profile: FloatArray, offsets: FloatArray, places: FloatArray, wet: FloatArray, dry: FloatArray
) -> FloatArray:
    """Logarithm of the likelihood ``(n, places)`` of profiles ``(n, samples)`` whose sides spread by ``(n,)``."""
    step = ndtr((offsets - places[:, None]) / _BLUR_PX)
    variance = (1.0 - step) * (wet**2)[:, None, None] + step * (dry**2)[:, None, None]
    rest = np.square(profile[:, None] - step) / variance + np.log(variance)
    return np.asarray(-0.5 * rest.sum(axis=-1))
