"""Masks to outlines: what a segmentation found, as the corners of its border in pixels."""

from typing import Final

import cv2
import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray

_SLACK_PX: Final = 0.3  # staircases of a mask are no corners
_HALVES: Final = np.ones((3, 3), dtype=np.uint8)


def outlines_of(mask: BoolArray, slack_px: float = _SLACK_PX) -> list[FloatArray]:
    """The outer borders of what is connected in a mask ``(height, width)``.

    A pixel is a square of side 1 around its centre, so a mask of one pixel has an outline of area 1.

    Args:
        mask: What belongs to objects.
        slack_px: How far a border may be off where it is made of fewer corners; 0 for every corner.

    Returns:
        ``(n, 2)`` each, the largest first.
    """
    if not np.any(mask):
        return []
    rows, columns = np.flatnonzero(np.any(mask, axis=1)), np.flatnonzero(np.any(mask, axis=0))
    top, left = int(rows[0]), int(columns[0])
    part = mask[top : rows[-1] + 1, left : columns[-1] + 1].astype(np.uint8)
    # On a grid of half pixels, borders between pixels have points of their own.
    halves = np.zeros((2 * part.shape[0] + 1, 2 * part.shape[1] + 1), dtype=np.uint8)
    halves[1::2, 1::2] = part
    found, _ = cv2.findContours(cv2.dilate(halves, _HALVES), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    found = sorted(found, key=cv2.contourArea, reverse=True)
    if slack_px > 0:
        found = [cv2.approxPolyDP(border, 2 * slack_px, closed=True) for border in found]
    return [border[:, 0].astype(np.float64) / 2 + [left - 0.5, top - 0.5] for border in found]
