"""``aerodft.image/1`` and ``aerodft.observation/1``: inputs as they are recorded, exact in every field."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from aerodft.adapters.wire.packed_json import PackedBytes, encode_payloads
from aerodft.adapters.wire.payload import (
    COUNT,
    INTEGER,
    NUMBER,
    PIXELS,
    STAMP,
    TEXT,
    Json,
    Payload,
    doc,
    integers,
    list_of,
    load_payload,
    load_payloads,
    one_of,
    or_null,
    pixel_pairs,
)
from aerodft.conventions import LARGEST
from aerodft.model import Box, Image, ImageRows, Observation, StampClock

IMAGE_SCHEMA = "aerodft.image/1"
OBSERVATION_SCHEMA = "aerodft.observation/1"

IMAGE: Final = Payload(
    IMAGE_SCHEMA,
    "An image's stamps and size",
    {
        "index": COUNT,
        "stamp_ns": STAMP,
        "arrival_ns": STAMP,
        "clock": doc(one_of(StampClock), "Whose clock the stamp is from"),
        "width_px": INTEGER,
        "height_px": INTEGER,
    },
)

OBSERVATION: Final = Payload(
    OBSERVATION_SCHEMA,
    "One probe's pixels, or the outline of what it measures, at one stamp",
    {
        "name": doc(TEXT, "The probe"),
        "stamp_ns": STAMP,
        "arrival_ns": STAMP,
        "clock": one_of(StampClock),
        "pixels": PIXELS,
        "box": doc(or_null(list_of(NUMBER, length=4)), "Left, top, right, bottom limit of an object, in pixels"),
        "contour": doc(or_null(list_of(list_of(NUMBER, length=2))), "Corners of an object's outline, in pixels"),
        "unseen": doc(or_null(TEXT), "Why there are no pixels: it was looked for, and not seen"),
        "std_px": NUMBER,
        "image": INTEGER,
        "source": TEXT,
    },
)

_CLOCKS: Final = {clock.value: clock for clock in StampClock}


def encode_image(image: Image) -> bytes:
    """An image's index, stamps and size as ``aerodft.image/1``; its pixels travel as JPEG elsewhere."""
    return IMAGE.dump(image)


def encode_images(images: Sequence[Image]) -> PackedBytes:
    """Each of some images as ``aerodft.image/1``."""
    if isinstance(images, ImageRows):
        kind = np.zeros(len(images), dtype=np.int64)
        columns = np.stack([images.indices, images.stamp_ns, images.arrival_ns])
    else:
        found: dict[tuple[StampClock, int | None, int | None], int] = {}
        kinds = [found.setdefault((image.clock, image.width_px, image.height_px), len(found)) for image in images]
        kind = np.array(kinds, dtype=np.int64)
        values = [(image.index, image.stamp_ns, image.arrival_ns) for image in images]
        columns = np.array(values, dtype=np.int64).reshape(-1, 3).T
    whole = dict(zip(("index", "stamp_ns", "arrival_ns"), columns, strict=True))
    return encode_payloads(kind[:, None], lambda row: IMAGE.to_json(images[row]), whole, np.empty((len(images), 0)))


def decode_image(data: bytes) -> Image:
    """``aerodft.image/1`` to an image without pixels.

    Raises:
        InputError: The payload is not of that schema.
    """
    return load_payload(data, IMAGE_SCHEMA, _image)


def decode_images(data: Sequence[bytes]) -> Sequence[Image]:
    """Payloads of ``aerodft.image/1`` to images without pixels: ``ImageRows`` where they can be.

    Raises:
        InputError: A payload is not of that schema.
    """
    return load_payloads(data, IMAGE_SCHEMA, _image, _image_rows)


def _image(payload: Json) -> Image:
    index, stamp_ns, arrival_ns = integers(payload["index"], payload["stamp_ns"], payload["arrival_ns"])
    return Image(
        index=index,
        stamp_ns=stamp_ns,
        arrival_ns=arrival_ns,
        clock=_CLOCKS[payload["clock"]],
        width_px=payload["width_px"],
        height_px=payload["height_px"],
    )


def _image_rows(payloads: Sequence[Json]) -> ImageRows | None:
    """Images as rows; None where they differ in more than whole numbers, or do not come in order of arrival."""
    common = {(each["clock"], each["width_px"], each["height_px"]) for each in payloads}
    kinds = {(type(each["width_px"]), type(each["height_px"])) for each in payloads}  # 1 and 1.0 are equal
    if len(common) != 1 or len(kinds) != 1:
        return None
    names = ("index", "stamp_ns", "arrival_ns")
    columns = [integers(*(each[name] for each in payloads)) for name in names]
    indices, stamp_ns, arrival_ns = np.array(columns, dtype=np.int64)
    clock, width_px, height_px = common.pop()
    if np.any(arrival_ns[1:] < arrival_ns[:-1]):
        return None
    return ImageRows(indices, stamp_ns, arrival_ns, _CLOCKS[clock], width_px, height_px)


def encode_observation(observation: Observation) -> bytes:
    """An observation as ``aerodft.observation/1``."""
    return OBSERVATION.dump(observation, contour=observation.contour or None, unseen=observation.unseen or None)


def decode_observations(data: Sequence[bytes]) -> Sequence[Observation]:
    """Payloads of ``aerodft.observation/1`` to observations.

    Raises:
        InputError: A payload is not of that schema.
    """
    return load_payloads(data, OBSERVATION_SCHEMA, _observation)


def _observation(payload: Json) -> Observation:
    stamp_ns, arrival_ns = integers(payload["stamp_ns"], payload["arrival_ns"])
    image, std_px = payload["image"], payload["std_px"]
    if std_px is not None and not 0 <= std_px <= LARGEST:
        raise ValueError(f"std_px {std_px!r:.60}")
    return Observation(
        name=_text(payload["name"]),
        stamp_ns=stamp_ns,
        arrival_ns=arrival_ns,
        pixels=pixel_pairs(payload["pixels"]),
        std_px=std_px,
        clock=StampClock(payload["clock"]),
        image=None if image is None else integers(image)[0],
        source=_text(payload["source"]),
        box=_box(payload.get("box")),  # recordings of old have none of these
        contour=pixel_pairs(payload.get("contour") or ()),
        unseen=_text(payload.get("unseen") or ""),
    )


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{value!r:.60} is no text")
    return value


def _box(values: list[float] | None) -> Box | None:
    if values is None:
        return None
    (left, top), (right, bottom) = pixel_pairs((values[:2], values[2:]))
    return left, top, right, bottom
