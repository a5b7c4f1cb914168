"""Crops of pictures as another camera, light and codec would have shown them."""

import math

import cv2
import numpy as np
from pictures import Bytes


def crop(
    pixels: Bytes,
    water: Bytes,
    size_px: tuple[int, int],
    scales: tuple[float, float],
    random: np.random.Generator,
    *,
    any_way_up: bool,
) -> tuple[Bytes, Bytes, Bytes]:
    """A part of a picture, turned, scaled and mirrored.

    Args:
        pixels: ``(height, width, 3)``.
        water: ``(height, width)``.
        size_px: Width and height of the crop.
        scales: The least and the most that it is scaled by.
        random: What is drawn from.
        any_way_up: Whether it may be turned upside down, as a picture from straight above may.

    Returns:
        The crop, its water, and 255 where the picture shows something, else 0.
    """
    height, width = water.shape
    scale = float(np.exp(random.uniform(math.log(scales[0]), math.log(scales[1]))))
    turn = random.uniform(-180, 180) if any_way_up else random.normal(0, 4)
    stretch = float(np.exp(random.normal(0, 0.08)))
    half = np.array(size_px) / 2 / scale
    low, high = np.minimum(half, [width / 2, height / 2]), np.maximum([width, height] - half, [width / 2, height / 2])
    middle = random.uniform(low, high)
    move = cv2.getRotationMatrix2D(middle.tolist(), turn, scale)
    move[:, 2] += np.array(size_px) / 2 - middle
    move[0] = (move[0] - [0, 0, size_px[0] / 2]) * stretch + [0, 0, size_px[0] / 2]
    if random.random() < 0.5:
        move[0] = [0, 0, size_px[0] - 1] - move[0]
    shrink = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    soft = cv2.GaussianBlur(pixels, (0, 0), 0.4 / scale) if scale < 0.8 else pixels
    return (
        np.asarray(cv2.warpAffine(soft, move, size_px, flags=shrink, borderMode=cv2.BORDER_CONSTANT)),
        np.asarray(cv2.warpAffine(water, move, size_px, flags=cv2.INTER_LINEAR)),
        np.asarray(cv2.warpAffine(np.full_like(water, 255), move, size_px, flags=cv2.INTER_NEAREST)),
    )


def disguise(pixels: Bytes, random: np.random.Generator) -> Bytes:
    """The same scene in other light, through another lens and codec."""
    values = pixels.astype(np.float32) / 255
    values = np.power(values, float(np.exp(random.normal(0, 0.15))))
    values *= np.exp(random.normal(0, 0.05, 3) + random.normal(0, 0.1)).astype(np.float32)
    grey = values @ np.array([0.114, 0.587, 0.299], dtype=np.float32)
    colour = random.uniform(0, 0.5) if random.random() < 0.08 else random.uniform(0.6, 1.6)
    values = grey[..., None] + (values - grey[..., None]) * np.float32(colour)
    if random.random() < 0.04:  # false colours
        values = values[..., random.permutation(3)]
    if random.random() < 0.15:
        values *= _shadows(values.shape[:2], random)[..., None]
    if random.random() < 0.1:
        values += random.uniform(0, 0.35) * (1 - values)
    if random.random() < 0.3:
        values = cv2.GaussianBlur(values, (0, 0), random.uniform(0.4, 1.8))
    if random.random() < 0.5:
        values += random.standard_normal(values.shape, dtype=np.float32) * np.float32(random.uniform(0, 0.025))
    image = np.clip(255 * values, 0, 255).astype(np.uint8)
    if random.random() < 0.4:
        _, code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(random.integers(15, 80))])
        image = cv2.imdecode(code, cv2.IMREAD_COLOR)
    return np.asarray(image)


def recoloured(pixels: Bytes, part: Bytes, random: np.random.Generator) -> Bytes:
    """A picture whose water (or land) has another colour, brightness and contrast.

    Args:
        pixels: ``(height, width, 3)`` BGR.
        part: ``(height, width)``: 255 where the colour changes.
        random: What is drawn from.
    """
    share = cv2.GaussianBlur(part.astype(np.float32) / 255, (0, 0), 1.2)[..., None]
    lab = cv2.cvtColor(pixels.astype(np.float32) / 255, cv2.COLOR_BGR2LAB)
    middle = lab[part > 127].mean(axis=0) if (part > 127).any() else np.zeros(3, np.float32)
    shift = (random.normal(0, [12, 10, 14])).astype(np.float32)
    changed = middle + shift + (lab - middle) * np.float32(np.exp(random.normal(0, 0.3)))
    other = 255 * cv2.cvtColor(np.clip(changed, [0, -110, -110], [100, 110, 110]).astype(np.float32), cv2.COLOR_LAB2BGR)
    return np.clip(pixels * (1 - share) + other * share, 0, 255).astype(np.uint8)


def _shadows(shape: tuple[int, int], random: np.random.Generator) -> np.ndarray:
    cells = int(random.integers(3, 12))
    noise = cv2.resize(
        random.standard_normal((cells, cells)).astype(np.float32), shape[::-1], interpolation=cv2.INTER_CUBIC
    )
    deep = random.uniform(0.2, 0.6)
    return 1 - deep / (1 + np.exp(-random.uniform(2, 15) * (noise - random.uniform(0, 1))))
