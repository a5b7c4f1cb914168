"""``aerodft.image/1`` and ``aerodft.observation/1``: inputs as they are recorded, exact in every field."""

from collections.abc import Sequence

from aerodft.adapters.codec import wire
from aerodft.model.image import Image, StampClock
from aerodft.model.observation import Box, Observation

IMAGE_SCHEMA = "aerodft.image/1"
OBSERVATION_SCHEMA = "aerodft.observation/1"


def encode_image(image: Image) -> bytes:
    """An image's index, stamps and size as ``aerodft.image/1``; its pixels travel as JPEG elsewhere."""
    return wire.dump(
        {
            "schema": IMAGE_SCHEMA,
            "index": image.index,
            "stamp_ns": str(image.stamp_ns),
            "arrival_ns": str(image.arrival_ns),
            "clock": image.clock,
            "width_px": image.width_px,
            "height_px": image.height_px,
            "software": wire.SOFTWARE,
        }
    )


def decode_image(data: bytes) -> Image:
    """``aerodft.image/1`` to an image without pixels.

    Raises:
        InputError: The payload is not of that schema.
    """
    return wire.load(data, IMAGE_SCHEMA, _image)


def decode_images(data: Sequence[bytes]) -> list[Image]:
    """The same of many."""
    return wire.load_all(data, IMAGE_SCHEMA, _image)


def _image(payload: wire.Json) -> Image:
    return Image(
        index=payload["index"],
        stamp_ns=int(payload["stamp_ns"]),
        arrival_ns=int(payload["arrival_ns"]),
        clock=StampClock(payload["clock"]),
        width_px=payload["width_px"],
        height_px=payload["height_px"],
    )


def encode_observation(observation: Observation) -> bytes:
    """An observation as ``aerodft.observation/1``."""
    return wire.dump(
        {
            "schema": OBSERVATION_SCHEMA,
            "name": observation.name,
            "stamp_ns": str(observation.stamp_ns),
            "arrival_ns": str(observation.arrival_ns),
            "clock": observation.clock,
            "pixels": observation.pixels,
            "box": observation.box,
            "contour": observation.contour or None,
            "unseen": observation.unseen or None,
            "std_px": observation.std_px,
            "image": observation.image,
            "source": observation.source,
            "software": wire.SOFTWARE,
        }
    )


def decode_observation(data: bytes) -> Observation:
    """``aerodft.observation/1`` to an observation.

    Raises:
        InputError: The payload is not of that schema.
    """
    return wire.load(data, OBSERVATION_SCHEMA, _observation)


def decode_observations(data: Sequence[bytes]) -> list[Observation]:
    """The same of many."""
    return wire.load_all(data, OBSERVATION_SCHEMA, _observation)


def _observation(payload: wire.Json) -> Observation:
    return Observation(
        name=payload["name"],
        stamp_ns=int(payload["stamp_ns"]),
        arrival_ns=int(payload["arrival_ns"]),
        pixels=wire.pixel_pairs(payload["pixels"]),
        std_px=payload["std_px"],
        clock=StampClock(payload["clock"]),
        image=payload["image"],
        source=payload["source"],
        box=_box(payload.get("box")),  # recordings of old have none of these
        contour=wire.pixel_pairs(payload.get("contour") or ()),
        unseen=payload.get("unseen") or "",
    )


def _box(values: list[float] | None) -> Box | None:
    if values is None:
        return None
    left, top, right, bottom = map(wire.number, values)
    return left, top, right, bottom
