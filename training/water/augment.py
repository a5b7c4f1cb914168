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


def waterside(pixels: Bytes, water: Bytes, random: np.random.Generator) -> Bytes:
    """A picture whose banks are harder to find: foam on the water, a bare margin of its colour, shade, rank growth.

    Args:
        pixels: ``(height, width, 3)`` BGR.
        water: ``(height, width)``: 255 where there is water; its edge stays where it is.
        random: What is drawn from.
    """
    wet = (water > 127).astype(np.uint8)
    if wet.all() or not wet.any():
        return pixels
    inland = cv2.distanceTransform(1 - wet, cv2.DIST_L2, 3) - cv2.distanceTransform(wet, cv2.DIST_L2, 3)
    share = cv2.GaussianBlur(wet.astype(np.float32), (0, 0), random.uniform(0.6, 1.3))[..., None]
    long_px = max(wet.shape)
    land, river = pixels.astype(np.float32), pixels.astype(np.float32)
    if random.random() < 0.4:  # rank growth
        blades = _streaks(wet.shape, random.uniform(1, 6), 1.0, random)
        land = land * (1 + random.uniform(0.05, 0.3) * blades)[..., None]
    if random.random() < 0.35:  # a margin of mud or stones, as bright as the water or not
        colour = pixels[wet > 0].mean(axis=0) * random.uniform(0.7, 1.5) + random.normal(0, 12, 3)
        ends = random.uniform(0.005, 0.06) * long_px * (1 + 0.4 * _streaks(wet.shape, 25, 1.0, random))
        bare = np.clip((ends - inland) / 2, 0, 1)[..., None] * random.uniform(0.6, 1)
        land = land + bare * (colour * (1 + 0.06 * _streaks(wet.shape, 1.5, 1.0, random))[..., None] - land)
    if random.random() < 0.45:  # foam, in streaks, at times along the bank
        streaks = _streaks(wet.shape, random.uniform(1, 5), random.uniform(1, 6), random)
        near = random.uniform(0, 1.5) * np.exp(np.minimum(inland, 0) / (0.03 * long_px)) * (random.random() < 0.5)
        foam = np.clip((streaks + near - random.uniform(1.2, 2.6)) * 2, 0, 1)[..., None] * random.uniform(0.4, 1)
        river = river + foam * (random.uniform(175, 245) - river)
    picture = river * share + land * (1 - share)
    if random.random() < 0.4:  # what stands on one bank, or both, throws its shade over the water
        reach = random.uniform(0.01, 0.12) * long_px * (1 + 0.4 * _streaks(wet.shape, 12, 1.0, random))
        dark = np.clip((inland + reach) / 2, 0, 1) * np.clip((random.uniform(0, 0.1) * long_px - inland) / 2, 0, 1)
        if random.random() < 0.6:
            _, parts = cv2.connectedComponents(1 - wet)
            side = cv2.GaussianBlur((parts == parts.max()).astype(np.float32), (0, 0), 0.04 * long_px)
            dark = dark * np.clip(3 * side, 0, 1)
        picture = picture * (1 - random.uniform(0.25, 0.7) * dark[..., None])
    return np.clip(picture, 0, 255).astype(np.uint8)


def _streaks(shape: tuple[int, int], size_px: float, longer: float, random: np.random.Generator) -> np.ndarray:
    """Noise of standard deviation 1: spots of a size, so many times longer in one direction."""
    rows, columns = (max(int(side / size_px) + 2, 3) for side in shape)
    columns = max(int(columns / longer), 3)
    noise = cv2.resize(random.standard_normal((rows, columns)).astype(np.float32), shape[::-1])
    turn = cv2.getRotationMatrix2D((shape[1] / 2, shape[0] / 2), random.uniform(-90, 90) if longer > 1 else 0.0, 1.0)
    turned = cv2.warpAffine(noise, turn, shape[::-1], borderMode=cv2.BORDER_REFLECT)
    return np.asarray(turned / max(float(turned.std()), 1e-3))


def _shadows(shape: tuple[int, int], random: np.random.Generator) -> np.ndarray:
    cells = int(random.integers(3, 12))
    noise = cv2.resize(
        random.standard_normal((cells, cells)).astype(np.float32), shape[::-1], interpolation=cv2.INTER_CUBIC
    )
    deep = random.uniform(0.2, 0.6)
    return 1 - deep / (1 + np.exp(-random.uniform(2, 15) * (noise - random.uniform(0, 1))))
