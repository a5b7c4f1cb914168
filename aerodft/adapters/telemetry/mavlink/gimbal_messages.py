"""The MAVLink messages in which gimbals report the camera's attitude: ``GIMBAL_MESSAGES``.

A new message is an entry here, with a function that makes a ``GimbalTrack`` of its rows, and the name of that track's
source in ``service.GIMBAL_SOURCES``. Which gimbal is followed, what ``doctor`` says of it, and of its angles, follow.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from aerodft.adapters.telemetry.mavlink.dialect import message_name
from aerodft.adapters.telemetry.tracks import Rows, gimbal_device_track, mount_orientation_track, mount_status_track
from aerodft.model import Track

MOUNT_STATUS, MOUNT_ORIENTATION, GIMBAL_DEVICE_ATTITUDE_STATUS = 158, 265, 285


@dataclass(frozen=True, slots=True, kw_only=True)
class GimbalMessage:
    """One message.

    Attributes:
        message_id: Its id.
        track: Makes its track, counting damaged rows by reason.
        pitch: Field of the pitch, and the field's unit in degrees; None for a quaternion.
    """

    message_id: int
    track: Callable[[Rows, Counter[str]], Track]
    pitch: tuple[str, float] | None = None

    @property
    def name(self) -> str:
        """The message's name, which is that of its source too."""
        return message_name(self.message_id)


GIMBAL_MESSAGES: Final = (
    GimbalMessage(message_id=MOUNT_STATUS, track=mount_status_track, pitch=("pointing_a", 0.01)),
    GimbalMessage(message_id=MOUNT_ORIENTATION, track=mount_orientation_track, pitch=("pitch", 1.0)),
    GimbalMessage(message_id=GIMBAL_DEVICE_ATTITUDE_STATUS, track=gimbal_device_track),
)
"""All of them."""
