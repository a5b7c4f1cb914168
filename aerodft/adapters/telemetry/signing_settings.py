"""How a link is signed, as it is configured."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

RADIO_STATUS: Final = "RADIO_STATUS"  # made by the radio itself, which has no key


@dataclass(frozen=True, slots=True, kw_only=True)
class SigningSettings:
    """How one link is signed.

    Attributes:
        key_file: Holds the key.
        state_file: Where its time stamps are kept; None for beside the key, as ``<key_file>.state``.
        link_id: Of what is sent on it.
        accept_unsigned: Names of messages that pass without a signature.
    """

    key_file: Path
    state_file: Path | None = None
    link_id: int = 0
    accept_unsigned: tuple[str, ...] = (RADIO_STATUS,)
