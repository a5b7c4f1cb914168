import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect


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
