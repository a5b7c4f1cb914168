"""JSON that others wrote: kilobytes of a recording unpack to megabytes of it, and these to gigabytes of objects."""

from typing import Any, Final

import orjson

MOST_JSON_BYTES: Final = 4 << 20
"""Of a payload without an image: a thousand measurements of one image take one or two."""
MOST_PICTURE_BYTES: Final = 16 << 20
"""Of a payload with an image as text."""
_MOST_COMMAS: Final = 200_000  # there is one for each value; an object of one key takes 300 bytes


def loads(data: bytes, most_bytes: int = MOST_JSON_BYTES) -> Any:  # noqa: ANN401 - whatever JSON holds
    """The value of a JSON text.

    Args:
        data: The text.
        most_bytes: No longer one is read.

    Raises:
        orjson.JSONDecodeError: It is no JSON text, or one of more than is believed.
    """
    if len(data) > most_bytes:
        raise orjson.JSONDecodeError(f"more than {most_bytes >> 20} MB", "", 0)
    if data.count(b",") > _MOST_COMMAS:
        raise orjson.JSONDecodeError(f"more than {_MOST_COMMAS} values", "", 0)
    return orjson.loads(data)
