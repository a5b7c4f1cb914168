"""Layouts of a .bin log's messages, as its FMT messages declare them."""

from functools import lru_cache
from typing import Final

import numpy as np

HEAD: Final = (0xA3, 0x95)
HEAD_SIZE: Final = 3
FMT_TYPE: Final = 128
FMT_SIZE: Final = 89
_FMT_DTYPE: Final = np.dtype([("type", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")])
_CODES: Final = {
    "a": ("<i2", (32,), 1.0),
    "b": ("i1", (), 1.0),
    "B": ("u1", (), 1.0),
    "g": ("<f2", (), 1.0),
    "h": ("<i2", (), 1.0),
    "H": ("<u2", (), 1.0),
    "i": ("<i4", (), 1.0),
    "I": ("<u4", (), 1.0),
    "f": ("<f4", (), 1.0),
    "n": ("S4", (), 1.0),
    "N": ("S16", (), 1.0),
    "Z": ("S64", (), 1.0),
    "c": ("<i2", (), 0.01),
    "C": ("<u2", (), 0.01),
    "e": ("<i4", (), 0.01),
    "E": ("<u4", (), 0.01),
    "L": ("<i4", (), 1e-7),
    "d": ("<f8", (), 1.0),
    "M": ("u1", (), 1.0),
    "q": ("<i8", (), 1.0),
    "Q": ("<u8", (), 1.0),
}


class MessageFormat:
    """One message's layout.

    Attributes:
        name: For instance ``GPS``.
        dtype: The structured type of a message without its three-byte head.
        scale: What a field's integer is multiplied by.
    """

    def __init__(self, name: str, codes: str, columns: list[str]) -> None:
        self.name = name
        self.dtype = np.dtype([(column, *_CODES[code][:2]) for code, column in zip(codes, columns, strict=True)])
        self.scale = {column: _CODES[code][2] for code, column in zip(codes, columns, strict=True)}


@lru_cache(maxsize=1024)  # every log declares the same few hundred, and is read more than once
def parse_format(message: bytes) -> tuple[int, MessageFormat] | None:
    """The type number and layout that a FMT message declares.

    Args:
        message: The whole message, head included.

    Returns:
        None where it contradicts itself or uses an unknown code.
    """
    if len(message) != FMT_SIZE:
        return None
    fmt = np.frombuffer(message, dtype=_FMT_DTYPE, offset=HEAD_SIZE)[0]
    name, codes, columns = (fmt[key].decode("ascii", "replace") for key in ("name", "format", "columns"))
    names = columns.split(",") if columns else []
    if len(names) != len(codes) or len(set(names)) != len(names) or not set(codes) <= _CODES.keys():
        return None
    layout = MessageFormat(name, codes, names)
    return (int(fmt["type"]), layout) if layout.dtype.itemsize + HEAD_SIZE == int(fmt["length"]) else None
