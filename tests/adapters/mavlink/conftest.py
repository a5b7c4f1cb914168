from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.model import RawBlock, WireProtocol
from aerodft.service import block_of

DATA = Path(__file__).parents[3].parent / "shared" / "data"


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of recorded flights."""
    if not DATA.is_dir():
        pytest.skip(f"no recorded flights: {DATA} is absent")
    return DATA


@pytest.fixture(scope="session")
def pack() -> Callable[..., bytes]:
    """Packs a message as pymavlink does: ``pack(message, system=1, component=1, v1=False)``."""

    def packed(message: dialect.MAVLink_message, *, system: int = 1, component: int = 1, v1: bool = False) -> bytes:
        mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        return bytes(message.pack(mav, force_mavlink1=v1))

    return packed


@pytest.fixture(scope="session")
def block() -> Callable[[list[bytes]], RawBlock]:
    """A block of frames that arrive a millisecond apart."""

    def made(frames: list[bytes]) -> RawBlock:
        return block_of(WireProtocol.MAVLINK, "test", [10**18 + k * 10**6 for k in range(len(frames))], frames)

    return made


@pytest.fixture(scope="session")
def flight_frames() -> list[bytes]:
    """200 frames of mixed messages and sizes, MAVLink 1 and 2, with fixed content."""
    rng = np.random.default_rng(5)
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    frames = []
    for k in range(200):
        angles = rng.uniform(-3, 3, 3)
        message = (
            dialect.MAVLink_attitude_message(k * 100, *angles, 0.1, 0.0, 0.0)
            if k % 3
            else dialect.MAVLink_statustext_message(6, bytes(rng.integers(0, 256, 40, dtype=np.uint8)))
        )
        mav.seq = k % 256
        frames.append(bytes(message.pack(mav, force_mavlink1=k % 4 == 0)))
    return frames
