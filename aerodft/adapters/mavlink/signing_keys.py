"""From a station's configuration to a checked link: the key's file, the state's file, the messages let in unsigned."""

import hashlib
import logging
import re
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Final

from aerodft.adapters.mavlink.dialect import MESSAGES
from aerodft.adapters.mavlink.signing import KEY_SIZE, SignatureCheck, SigningState
from aerodft.adapters.mavlink.signing_settings import RADIO_STATUS, SigningSettings
from aerodft.errors import ConfigError

_LOG: Final = logging.getLogger(__name__)
_MOST_BYTES: Final = 4096
_OTHERS: Final = stat.S_IRWXG | stat.S_IRWXO
_SHORT: Final = 12  # characters: one hash a try, ten thousand million of them a second
_EXPECTED: Final = "64 hexadecimal digits, or a passphrase"


def load_key(path: Path) -> bytes:
    """The 32 bytes of a key file; a passphrase is hashed as the ground stations do (SHA-256 of its UTF-8 text).

    Raises:
        ConfigError: It is missing, unreadable, empty or no text.
    """
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
        if path.stat().st_mode & _OTHERS:
            _LOG.warning("%s: others than its owner may read or write this key; chmod 600 it", path)
    except OSError as error:
        got = error.strerror or str(error)
        raise ConfigError("cannot read the signing key", where=path, got=got, expected=_EXPECTED) from error
    try:
        text = data.decode().strip("\r\n")
    except UnicodeDecodeError:
        raise ConfigError("no signing key", where=path, got="binary data", expected=_EXPECTED) from None
    if not text.strip() or len(data) > _MOST_BYTES:
        got = "nothing" if not text.strip() else f"more than {_MOST_BYTES} bytes"
        raise ConfigError("no signing key", where=path, got=got, expected=_EXPECTED)
    return _key_of(text, path)


def _key_of(text: str, path: Path) -> bytes:
    """The key that a text stands for; one that is almost 64 hexadecimal digits is a mistake, no passphrase."""
    digits = text.strip()
    if re.fullmatch(rf"[0-9a-fA-F]{{{KEY_SIZE},}}", digits) is None:
        if len(text) < _SHORT:
            _LOG.warning("%s: a passphrase of %d characters is soon guessed; take %d or more", path, len(text), _SHORT)
        return hashlib.sha256(text.encode()).digest()
    if len(digits) != 2 * KEY_SIZE:
        raise ConfigError("no signing key", where=path, got=f"{len(digits)} hexadecimal digits", expected=_EXPECTED)
    return bytes.fromhex(digits)


def open_signing(settings: SigningSettings, now_ns: Callable[[], int]) -> SignatureCheck:
    """The check of a link that is about to be opened.

    Args:
        settings: What is configured.
        now_ns: Host UTC, as good as it is known at the moment.

    Raises:
        ConfigError: The key cannot be read, or there is no such message.
        InputError: The state is damaged, cannot be written, or another process holds it.
    """
    ids = {str(message.msgname): message_id for message_id, message in MESSAGES.items()}
    for name in settings.accept_unsigned:
        if name not in ids:
            raise ConfigError("accept_unsigned", got=f'"{name}"', expected=f'a message like "{RADIO_STATUS}"')
    key = load_key(settings.key_file)
    beside = settings.key_file.with_name(f"{settings.key_file.name}.state")
    return SignatureCheck(
        key,
        SigningState.open(settings.state_file or beside, key),
        now_ns,
        link_id=settings.link_id,
        unsigned_ids=frozenset(ids[name] for name in settings.accept_unsigned),
    )
