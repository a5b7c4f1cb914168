"""Which frames of a block are decoded: the wanted messages of one vehicle, decided frame by frame in order.

The rules that depend on what came before live in one sequential kernel, so that the outcome does not depend on how
the frames were cut into blocks.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from aerodft.adapters.mavlink.dialect import TABLE_IDS, payload_dtype
from aerodft.adapters.mavlink.kernels import Bytes
from aerodft.geometry.jit import njit
from aerodft.model.arrays import IntArray

HEARTBEAT, SYSTEM_TIME, ATTITUDE, GLOBAL_POSITION_INT, DISTANCE_SENSOR, TERRAIN_REPORT = 0, 2, 30, 33, 132, 136
ALTITUDE, MOUNT_STATUS, RANGEFINDER, MOUNT_ORIENTATION, GIMBAL_DEVICE_ATTITUDE_STATUS = 141, 158, 173, 265, 285
GPS_RAW_INT, EKF_STATUS_REPORT, ESTIMATOR_STATUS = 24, 193, 230
CAMERA_SETTINGS, VIDEO_STREAM_INFORMATION, CAMERA_FOV_STATUS = 260, 269, 271
TIMESYNC = 111
OF_POSES: Final = (
    SYSTEM_TIME,
    ATTITUDE,
    GLOBAL_POSITION_INT,
    DISTANCE_SENSOR,
    TERRAIN_REPORT,
    ALTITUDE,
    MOUNT_STATUS,
    RANGEFINDER,
    MOUNT_ORIENTATION,
    GIMBAL_DEVICE_ATTITUDE_STATUS,
)
_OF_HEALTH: Final = (GPS_RAW_INT, EKF_STATUS_REPORT, ESTIMATOR_STATUS)
OF_AUTOPILOT: Final = (HEARTBEAT, SYSTEM_TIME, ATTITUDE, GLOBAL_POSITION_INT, *_OF_HEALTH, TIMESYNC)
OF_CAMERAS: Final = (CAMERA_SETTINGS, VIDEO_STREAM_INFORMATION, CAMERA_FOV_STATUS)
WANTED: Final = (HEARTBEAT, *OF_POSES, *_OF_HEALTH, *OF_CAMERAS, TIMESYNC)
# The selection's state: what was decided so far, then each wanted message's component.
SYSTEM, COMPONENT, SENSOR_SEEN, TERRAIN_SEEN, DAMAGED, OTHER_GIMBALS = 0, 1, 2, 3, 4, 5
ASKED_COMPONENT, ASKED_GIMBAL, OTHER_SENSORS, LOOKS_ASIDE, LOCKS = 6, 7, 8, 9, 10
ORIENTATION_DOWN = 25

_UNDECIDED = -1
_TYPE_AT = payload_dtype(HEARTBEAT).fields["type"][1]  # type: ignore[index] # structured: it has fields
_AUTOPILOT_AT = payload_dtype(HEARTBEAT).fields["autopilot"][1]  # type: ignore[index] # structured: it has fields
_ORIENTATION_AT = payload_dtype(DISTANCE_SENSOR).fields["orientation"][1]  # type: ignore[index] # as above
_DEVICE_AT = payload_dtype(GIMBAL_DEVICE_ATTITUDE_STATUS).fields["gimbal_device_id"][1]  # type: ignore[index] # as above
_SPACING_AT = payload_dtype(TERRAIN_REPORT).fields["spacing"][1]  # type: ignore[index] # as above
_SENSOR_AT = payload_dtype(DISTANCE_SENSOR).fields["id"][1]  # type: ignore[index] # as above
_DEVICE_BITS, _COMPONENT_MASK = 8, 0xFF
_TYPE_GCS, _AUTOPILOT_NONE = 6, 8
# A gimbal's number: up to 6 one that an autopilot speaks for, from 7 on the component that it is itself.
_FIRST_GIMBAL_COMPONENT = 7
# Cameras, gimbals, planners and companion computers send the vehicle's messages about themselves.
_CAMERA_FIRST, _CAMERA_LAST, _GIMBAL, _OTHER_FIRST, _OTHER_LAST = 100, 105, 154, 171, 199


def _slots() -> npt.NDArray[np.int16]:
    """``(65536,)`` index into ``WANTED`` by message id, -1 for the rest."""
    slots = np.full(TABLE_IDS, -1, dtype=np.int16)
    slots[list(WANTED)] = np.arange(len(WANTED))
    slots.setflags(write=False)
    return slots


SLOTS: Final = _slots()


@dataclass(frozen=True, slots=True, kw_only=True)
class Followed:
    """Who is listened to; None for whoever is heard first.

    Attributes:
        system: MAVLink system id of the vehicle.
        component: Component id of its autopilot.
        gimbal: Up to 6 the number of a gimbal that the autopilot speaks for, from 7 on a gimbal's component id.
    """

    system: int | None = None
    component: int | None = None
    gimbal: int | None = None


def fresh_state(followed: Followed) -> IntArray:
    """The state before the first frame."""
    state = np.full(LOCKS + len(WANTED), _UNDECIDED, dtype=np.int64)
    state[SENSOR_SEEN:ASKED_COMPONENT] = state[OTHER_SENSORS:LOCKS] = 0
    asked = ((SYSTEM, followed.system), (ASKED_COMPONENT, followed.component), (ASKED_GIMBAL, followed.gimbal))
    for place, value in asked:
        state[place] = _UNDECIDED if value is None else value
    return state


@njit
def is_peripheral(component: int) -> bool:
    """Whether a component is a camera, a gimbal or another companion: what it says of attitude is its own."""
    return (
        _CAMERA_FIRST <= component <= _CAMERA_LAST or component == _GIMBAL or _OTHER_FIRST <= component <= _OTHER_LAST
    )


def device_of(state: IntArray, slot: int) -> int:
    """The gimbal's or sensor's number at that component; 0 where the component is the gimbal."""
    if state[LOCKS + slot] == _UNDECIDED:
        return max(int(state[ASKED_GIMBAL]), 0)
    return int(state[LOCKS + slot]) >> _DEVICE_BITS


@njit
def _byte(data: Bytes, payload_at: int, length: int, index: int) -> int:
    """One payload byte; what MAVLink 2 cut off is zero."""
    return int(data[payload_at + index]) if index < length else 0


@njit
def _is_vehicle(data: Bytes, message_id: int, component: int, payload_at: int, length: int) -> bool:
    """Whether this frame could only come from an autopilot."""
    if message_id == HEARTBEAT:
        kind = _byte(data, payload_at, length, _TYPE_AT)
        return kind != _TYPE_GCS and _byte(data, payload_at, length, _AUTOPILOT_AT) != _AUTOPILOT_NONE
    return not is_peripheral(component) and message_id in (ATTITUDE, GLOBAL_POSITION_INT)


@njit
def _asked_for(state: IntArray, message_id: int, component: int, device: int) -> bool:
    """Whether a message comes from the gimbal that is asked for, or from no gimbal at all."""
    asked = state[ASKED_GIMBAL]
    if asked == _UNDECIDED or message_id not in (MOUNT_STATUS, MOUNT_ORIENTATION, GIMBAL_DEVICE_ATTITUDE_STATUS):
        return True
    if asked >= _FIRST_GIMBAL_COMPONENT:
        return bool(component == asked)
    if message_id == GIMBAL_DEVICE_ATTITUDE_STATUS and device != asked:
        state[OTHER_GIMBALS] += 1
        return False
    return True


@njit
def _admit(state: IntArray, message_id: int, slot: int, component: int, device: int) -> bool:
    """Whether a message of the followed system comes from the component that is listened to for it.

    The clock, the attitude, the position and the vehicle's health come from the autopilot, reports of cameras from all
    of them (``service.zoom`` chooses); anything else from whoever sent it first, and of several gimbals or
    sensors that one component speaks for from the first.
    """
    if message_id in OF_AUTOPILOT:
        return bool(component == state[COMPONENT])
    if message_id in OF_CAMERAS:
        return True
    if not _asked_for(state, message_id, component, device):
        return False
    sender = component | device << _DEVICE_BITS
    if state[LOCKS + slot] == _UNDECIDED:
        state[LOCKS + slot] = sender
    if component == state[LOCKS + slot] & _COMPONENT_MASK and sender != state[LOCKS + slot]:
        state[OTHER_SENSORS if message_id == DISTANCE_SENSOR else OTHER_GIMBALS] += 1
    return bool(sender == state[LOCKS + slot])


@njit
def _device(data: Bytes, message_id: int, payload_at: int, length: int) -> int:
    """The number of the gimbal or sensor that a message is of; -1 of a sensor that does not look down."""
    if message_id == GIMBAL_DEVICE_ATTITUDE_STATUS:
        return _byte(data, payload_at, length, _DEVICE_AT)
    if message_id == DISTANCE_SENSOR:
        looks_down = _byte(data, payload_at, length, _ORIENTATION_AT) == ORIENTATION_DOWN
        return _byte(data, payload_at, length, _SENSOR_AT) if looks_down else -1
    return 0


@njit
def _superseded(state: IntArray, message_id: int, spacing: int) -> bool:
    """Whether a better message of the same height is known (notes it where this is the one).

    A sensor that sees nothing still speaks for RANGEFINDER, which does not say so; a terrain report without a database,
    of ``spacing`` 0, speaks for nobody.
    """
    if message_id == DISTANCE_SENSOR:
        state[SENSOR_SEEN] = 1
    elif message_id == TERRAIN_REPORT and spacing != 0:
        state[TERRAIN_SEEN] = 1
    return (message_id == RANGEFINDER and state[SENSOR_SEEN] == 1) or (
        message_id == ALTITUDE and state[TERRAIN_SEEN] == 1
    )


@njit
def select(data: Bytes, heads: IntArray, slots: npt.NDArray[np.int16], state: IntArray, rows: IntArray) -> None:
    """Find what is to be decoded.

    Args:
        data: The block's bytes.
        heads: ``(5, n)`` from ``kernels.read_headers``.
        slots: ``SLOTS``.
        state: From ``fresh_state``, updated.
        rows: ``(n,)`` filled with the index into ``WANTED``, -1 for what is not decoded.
    """
    for k in range(heads.shape[1]):
        rows[k] = -1
        message_id, system, component, payload_at, length = heads[:, k]
        if message_id < 0:
            state[DAMAGED] += 1
        slot = slots[message_id] if 0 <= message_id < TABLE_IDS else -1
        if slot < 0:
            continue
        if state[COMPONENT] == _UNDECIDED and _is_vehicle(data, message_id, component, payload_at, length):
            if state[SYSTEM] == _UNDECIDED:
                state[SYSTEM] = system
            if state[SYSTEM] == system and state[ASKED_COMPONENT] in (_UNDECIDED, component):
                state[COMPONENT] = component
        if state[COMPONENT] == _UNDECIDED or system != state[SYSTEM]:
            continue
        device = _device(data, message_id, payload_at, length)
        if device < 0:
            state[LOOKS_ASIDE] += 1
            continue
        spacing = _byte(data, payload_at, length, _SPACING_AT) | _byte(data, payload_at, length, _SPACING_AT + 1)
        if _admit(state, message_id, slot, component, device) and not _superseded(state, message_id, spacing):
            rows[k] = slot
