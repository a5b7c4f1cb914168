"""MAVLink frames to telemetry tracks: which are decoded, whose they are, and what of them was lost.

The rules of selection that depend on what came before live in one sequential kernel, so that the outcome does not
depend on how the frames were cut into blocks.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from aerodft.adapters.telemetry.mavlink.dialect import TABLE_IDS, field_offset, message_name, payload_dtype
from aerodft.adapters.telemetry.mavlink.framing import headers, payload_rows
from aerodft.adapters.telemetry.mavlink.gimbal_messages import GIMBAL_DEVICE_ATTITUDE_STATUS, GIMBAL_MESSAGES
from aerodft.adapters.telemetry.mavlink.kernels import V2_HEAD, Bytes
from aerodft.adapters.telemetry.tracks import (
    NO_SCALE,
    Rows,
    StuckAngles,
    altitude_track,
    boot_ns_of,
    camera_feedback_track,
    camera_trigger_track,
    clock_track,
    distance_sensor_track,
    ekf_track,
    estimator_track,
    fov_track,
    gimbal_failure_tracks,
    gimbal_type_track,
    gps_track,
    heading_track,
    heartbeat_track,
    image_captured_track,
    landed_track,
    number_cameras,
    position_track,
    rangefinder_track,
    receiver_track,
    settings_track,
    sync_track,
    terrain_track,
    vehicle_track,
    video_stream_track,
)
from aerodft.conventions import SECOND_NS
from aerodft.jit import njit
from aerodft.model import NO_BOOT_TIME, BoolArray, IntArray, LinkTrack, OtherSenderTrack, RawBlock, Track, WireProtocol
from aerodft.service import AngleScale

HEARTBEAT, SYSTEM_TIME, ATTITUDE, GLOBAL_POSITION_INT, DISTANCE_SENSOR, TERRAIN_REPORT = 0, 2, 30, 33, 132, 136
ALTITUDE, RANGEFINDER = 141, 173
GPS_RAW_INT, EKF_STATUS_REPORT, ESTIMATOR_STATUS = 24, 193, 230
CAMERA_SETTINGS, VIDEO_STREAM_INFORMATION, CAMERA_FOV_STATUS = 260, 269, 271
EXTENDED_SYS_STATE = 245
CAMERA_TRIGGER, CAMERA_FEEDBACK, CAMERA_IMAGE_CAPTURED = 112, 180, 263
OF_TRIGGERS: Final = (CAMERA_TRIGGER, CAMERA_FEEDBACK, CAMERA_IMAGE_CAPTURED)
TIMESYNC, GIMBAL_MANAGER_INFORMATION, GIMBAL_DEVICE_INFORMATION = 111, 280, 283
_OF_HEALTH: Final = (GPS_RAW_INT, EKF_STATUS_REPORT, ESTIMATOR_STATUS, EXTENDED_SYS_STATE)
OF_AUTOPILOT: Final = (HEARTBEAT, SYSTEM_TIME, ATTITUDE, GLOBAL_POSITION_INT, *_OF_HEALTH, TIMESYNC)
OF_CAMERAS: Final = (CAMERA_SETTINGS, VIDEO_STREAM_INFORMATION, CAMERA_FOV_STATUS)
_MAKERS: Final[dict[int, Callable[[Rows, Counter[str]], Track]]] = {
    HEARTBEAT: heartbeat_track,
    SYSTEM_TIME: clock_track,
    ATTITUDE: vehicle_track,
    GLOBAL_POSITION_INT: position_track,
    DISTANCE_SENSOR: distance_sensor_track,
    TERRAIN_REPORT: terrain_track,
    ALTITUDE: altitude_track,
    RANGEFINDER: rangefinder_track,
    **{each.message_id: each.track for each in GIMBAL_MESSAGES},
    GPS_RAW_INT: gps_track,
    EKF_STATUS_REPORT: ekf_track,
    ESTIMATOR_STATUS: estimator_track,
    CAMERA_SETTINGS: settings_track,
    VIDEO_STREAM_INFORMATION: video_stream_track,
    CAMERA_FOV_STATUS: fov_track,
    TIMESYNC: sync_track,
    GIMBAL_MANAGER_INFORMATION: gimbal_type_track,
    GIMBAL_DEVICE_INFORMATION: gimbal_type_track,
    EXTENDED_SYS_STATE: landed_track,
    CAMERA_TRIGGER: camera_trigger_track,
    CAMERA_FEEDBACK: camera_feedback_track,
    CAMERA_IMAGE_CAPTURED: image_captured_track,
}
"""What makes a track of each message that is decoded; to decode another one, it gets an entry here."""

WANTED: Final = tuple(_MAKERS)
_DESCRIPTIONS: Final = (GIMBAL_MANAGER_INFORMATION, GIMBAL_DEVICE_INFORMATION)
OF_POSES: Final = tuple(
    each
    for each in _MAKERS
    if each not in {HEARTBEAT, TIMESYNC, *_DESCRIPTIONS, *_OF_HEALTH, *OF_CAMERAS, *OF_TRIGGERS}
)

ORIENTATION_DOWN = 25


class State(IntEnum):
    """Places in the array in which the selection keeps what it has decided so far."""

    SYSTEM = 0  # the vehicle's system id
    COMPONENT = 1  # its autopilot's component id
    SENSOR_SEEN = 2  # 1 once a DISTANCE_SENSOR has come
    TERRAIN_SEEN = 3  # 1 once a TERRAIN_REPORT with a database has
    OTHER_GIMBALS = 4  # messages of gimbals that are not followed
    CHOSEN_COMPONENT = 5  # what the station's file asks for
    CHOSEN_GIMBAL = 6
    OTHER_SENSORS = 7  # messages of rangefinders that are not followed
    LOOKS_ASIDE = 8  # messages of rangefinders that do not look down
    SENDERS = 9  # from here on, by ``WANTED``: the component, with its device's number, that a message is taken from


_UNDECIDED = -1
_TYPE_AT = field_offset(HEARTBEAT, "type")
_AUTOPILOT_AT = field_offset(HEARTBEAT, "autopilot")
_ORIENTATION_AT = field_offset(DISTANCE_SENSOR, "orientation")
_DEVICE_AT = field_offset(GIMBAL_DEVICE_ATTITUDE_STATUS, "gimbal_device_id")
_DESCRIBED_AT = field_offset(GIMBAL_DEVICE_INFORMATION, "gimbal_device_id")  # 0 where the gimbal itself says it
_MANAGED_AT = field_offset(GIMBAL_MANAGER_INFORMATION, "gimbal_device_id")
_SPACING_AT = field_offset(TERRAIN_REPORT, "spacing")
_SENSOR_AT = field_offset(DISTANCE_SENSOR, "id")
_DEVICE_BITS, _COMPONENT_MASK = 8, 0xFF
_TYPE_GCS, _AUTOPILOT_NONE = 6, 8
# A gimbal's number: up to 6 one that an autopilot speaks for, from 7 on the component that it is itself.
_FIRST_GIMBAL_COMPONENT = 7
# Cameras, gimbals, planners and companion computers send the vehicle's messages about themselves.
_CAMERA_FIRST, _CAMERA_LAST, _GIMBAL, _OTHER_FIRST, _OTHER_LAST = 100, 105, 154, 171, 199
OF_ANOTHER_ADDRESS: Final = "frames: with the autopilot's ids, from another address"
_SILENCE_NS: Final = SECOND_NS  # of the followed address, before another one is taken for its successor
_OF_VEHICLES: Final = (ATTITUDE, GLOBAL_POSITION_INT)
_OF_GIMBALS: Final = tuple(each.message_id for each in GIMBAL_MESSAGES)
_V1_SEQUENCE_AT, _V2_SEQUENCE_AT = 2, 4
_MODULUS: Final = 256
_WINDOW: Final = 64  # frames: what is that far behind is not late, but of a counter that started anew
_DTYPES: Final = {message_id: payload_dtype(message_id) for message_id in _MAKERS}


def _slots() -> npt.NDArray[np.int16]:
    """``(65536,)`` index into ``WANTED`` by message id, -1 for the rest."""
    slots = np.full(TABLE_IDS, -1, dtype=np.int16)
    slots[list(WANTED)] = np.arange(len(WANTED))
    slots.setflags(write=False)
    return slots


SLOTS: Final = _slots()


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedIds:
    """Ids of the vehicle to follow, None for the first that is heard; and how its gimbals' angles are read.

    Attributes:
        system: MAVLink system id of the vehicle.
        component: Component id of its autopilot.
        gimbal: Up to 6 the number of a gimbal that the autopilot speaks for, from 7 on a gimbal's component id.
        angle_scales: Factors of gimbals' angles with a wrong sign or unit, by the name of the message.
        gps_lon_first: Whether places without names have the longitude first; None to tell it by the log.
    """

    system: int | None = None
    component: int | None = None
    gimbal: int | None = None
    angle_scales: Mapping[str, AngleScale] = field(default_factory=dict)
    gps_lon_first: bool | None = None


def fresh_state(followed: FollowedIds) -> IntArray:
    """The state before the first frame."""
    state = np.full(State.SENDERS + len(WANTED), _UNDECIDED, dtype=np.int64)
    state[State.SENSOR_SEEN : State.CHOSEN_COMPONENT] = state[State.OTHER_SENSORS : State.SENDERS] = 0
    chosen = (
        (State.SYSTEM, followed.system),
        (State.CHOSEN_COMPONENT, followed.component),
        (State.CHOSEN_GIMBAL, followed.gimbal),
    )
    for place, value in chosen:
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
    if state[State.SENDERS + slot] == _UNDECIDED:
        return max(int(state[State.CHOSEN_GIMBAL]), 0)
    return int(state[State.SENDERS + slot]) >> _DEVICE_BITS


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
def _is_of_chosen_gimbal(state: IntArray, message_id: int, component: int, device: int) -> bool:
    """Whether a message comes from the chosen gimbal, or from no gimbal at all."""
    chosen = state[State.CHOSEN_GIMBAL]
    if chosen == _UNDECIDED or message_id not in (*_OF_GIMBALS, *_DESCRIPTIONS):
        return True
    if message_id == GIMBAL_MANAGER_INFORMATION:
        return bool(device == chosen)
    if chosen >= _FIRST_GIMBAL_COMPONENT:
        return bool(component == chosen)
    if message_id == GIMBAL_DEVICE_ATTITUDE_STATUS and device != chosen:
        state[State.OTHER_GIMBALS] += 1
        return False
    return message_id != GIMBAL_DEVICE_INFORMATION or device in (0, chosen)


@njit
def _is_from_followed(state: IntArray, message_id: int, slot: int, component: int, device: int) -> bool:
    """Whether a message of the followed system comes from the component that is listened to for it.

    The clock, the attitude, the position and the vehicle's health come from the autopilot, reports of cameras from all
    of them (``service.pose.zoom`` chooses); anything else from whoever sent it first, and of several gimbals or
    sensors that one component speaks for from the first.
    """
    if message_id in OF_AUTOPILOT:
        return bool(component == state[State.COMPONENT])
    if message_id in OF_CAMERAS:
        return True
    if not _is_of_chosen_gimbal(state, message_id, component, device):
        return False
    sender = component | device << _DEVICE_BITS
    if state[State.SENDERS + slot] == _UNDECIDED:
        state[State.SENDERS + slot] = sender
    if message_id not in _DESCRIPTIONS and (
        component == state[State.SENDERS + slot] & _COMPONENT_MASK and sender != state[State.SENDERS + slot]
    ):
        state[State.OTHER_SENSORS if message_id == DISTANCE_SENSOR else State.OTHER_GIMBALS] += 1
    return bool(sender == state[State.SENDERS + slot])


@njit
def _device(data: Bytes, message_id: int, payload_at: int, length: int) -> int:
    """The number of the gimbal or sensor that a message is of; -1 of a sensor that does not look down."""
    if message_id == GIMBAL_DEVICE_ATTITUDE_STATUS:
        return _byte(data, payload_at, length, _DEVICE_AT)
    if message_id == GIMBAL_DEVICE_INFORMATION:
        return _byte(data, payload_at, length, _DESCRIBED_AT)
    if message_id == GIMBAL_MANAGER_INFORMATION:
        return _byte(data, payload_at, length, _MANAGED_AT)
    if message_id == DISTANCE_SENSOR:
        looks_down = _byte(data, payload_at, length, _ORIENTATION_AT) == ORIENTATION_DOWN
        return _byte(data, payload_at, length, _SENSOR_AT) if looks_down else -1
    return 0


@njit
def _is_superseded(state: IntArray, message_id: int, spacing: int) -> bool:
    """Note the better messages of a height, and tell whether one of them makes this message superfluous.

    Once a DISTANCE_SENSOR has come, RANGEFINDER is left out for good; ALTITUDE once a TERRAIN_REPORT has.
    A sensor that sees nothing still speaks for RANGEFINDER, which does not say so; a terrain report without a database,
    of ``spacing`` 0, speaks for nobody.
    """
    if message_id == DISTANCE_SENSOR:
        state[State.SENSOR_SEEN] = 1
    elif message_id == TERRAIN_REPORT and spacing != 0:
        state[State.TERRAIN_SEEN] = 1
    return (message_id == RANGEFINDER and state[State.SENSOR_SEEN] == 1) or (
        message_id == ALTITUDE and state[State.TERRAIN_SEEN] == 1
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
        slot = slots[message_id] if 0 <= message_id < TABLE_IDS else -1
        if slot < 0:
            continue
        if state[State.COMPONENT] == _UNDECIDED and _is_vehicle(data, message_id, component, payload_at, length):
            if state[State.SYSTEM] == _UNDECIDED:
                state[State.SYSTEM] = system
            if state[State.SYSTEM] == system and state[State.CHOSEN_COMPONENT] in (_UNDECIDED, component):
                state[State.COMPONENT] = component
        if state[State.COMPONENT] == _UNDECIDED or system != state[State.SYSTEM]:
            continue
        device = _device(data, message_id, payload_at, length)
        if device < 0:
            state[State.LOOKS_ASIDE] += 1
            continue
        spacing = _byte(data, payload_at, length, _SPACING_AT) | _byte(data, payload_at, length, _SPACING_AT + 1)
        if _is_from_followed(state, message_id, slot, component, device) and not _is_superseded(
            state, message_id, spacing
        ):
            rows[k] = slot


class SharedAddress:
    """Leaves out what a second address says in the name of the autopilot, while the first goes on.

    Addresses that follow each other are one sender: a bridge that reconnects, or that opens a port for every datagram
    and so never speaks twice from the same. A gimbal or a camera may have an address of its own.
    """

    def __init__(self) -> None:
        self._followed: str | None = None
        self._last_ns = 0
        self._spoke_again = False

    def own_frames(
        self, block: RawBlock, heads: IntArray, state: IntArray, rejected: Counter[str]
    ) -> tuple[RawBlock, IntArray]:
        """A block and its headers ``(5, n)``, without what is of somebody else.

        Args:
            block: Frames of one sender.
            heads: From ``kernels.read_headers``.
            state: Of the selection, which knows the autopilot.
            rejected: Counts what is left out.
        """
        if state[State.COMPONENT] < 0:
            return block, heads
        own = (heads[0] >= 0) & (heads[1] == state[State.SYSTEM]) & (heads[2] == state[State.COMPONENT])
        if not own.any() or self._admits(block.sender, block.arrival_ns[own]):
            return block, heads
        rejected[f"{OF_ANOTHER_ADDRESS} than {self._followed}"] += int(own.sum())
        rows = {name: getattr(block, name)[~own] for name in ("arrival_ns", "offset", "length")}
        return replace(block, **rows), np.ascontiguousarray(heads[:, ~own])

    def _admits(self, sender: str, arrival_ns: IntArray) -> bool:
        if sender == self._followed:
            self._spoke_again = True
        elif self._spoke_again and int(arrival_ns[0]) - self._last_ns <= _SILENCE_NS:
            return False
        else:
            self._followed, self._spoke_again = sender, False
        self._last_ns = int(arrival_ns[-1])
        return True


def _table() -> BoolArray:
    """``(65536,)`` by message id: whether a message that was left out may be of a rival."""
    table = np.zeros(TABLE_IDS, dtype=np.bool_)
    table[[*_OF_VEHICLES, *_OF_GIMBALS]] = True
    return table


_TELLS: Final = _table()


class OtherSenders:
    """Names whoever else could have been followed: other vehicles, autopilots and gimbals.

    Args:
        followed: What was chosen; of that there are no rivals.
    """

    def __init__(self, followed: FollowedIds) -> None:
        self._followed = followed

    def tracks(self, block: RawBlock, heads: IntArray, slots: IntArray, state: IntArray) -> Iterator[OtherSenderTrack]:
        """One track for each of them that spoke in a block.

        Args:
            block: The frames.
            heads: ``(5, n)`` their headers.
            slots: ``(n,)`` which were selected: -1 for what was left out.
            state: Of the selection, which knows who is followed.
        """
        if state[State.COMPONENT] < 0:
            return
        aside = np.flatnonzero(slots < 0)
        aside = aside[_TELLS[np.clip(heads[0, aside], 0, TABLE_IDS - 1)]]
        if not len(aside):
            return
        who, member = np.unique(heads[:3, aside], axis=1, return_inverse=True)
        for number, (message_id, system, component) in enumerate(who.T.tolist()):
            what = self._sentence(message_id, system, component, state)
            if what is not None:
                rows = aside[member.ravel() == number]
                none = np.full(len(rows), NO_BOOT_TIME, dtype=np.int64)
                yield OtherSenderTrack(arrival_ns=block.arrival_ns[rows], boot_ns=none, what=what)

    def _sentence(self, message_id: int, system: int, component: int, state: IntArray) -> str | None:
        """Sentence on the sender of a message left out; None where it could not have been meant."""
        own_system, own_component = int(state[State.SYSTEM]), int(state[State.COMPONENT])
        if system != own_system:
            is_rival = self._followed.system is None and not self._is_of_gimbal(message_id, component)
            other, own, key = f"system {system}", f"system {own_system}", "system"
            return _heard_too(f"{other} is on the link too", own, key) if is_rival else None
        if message_id in _OF_GIMBALS:
            return None if self._followed.gimbal is not None else _gimbal(message_id, component, state)
        is_rival = component != own_component and self._followed.component is None and not is_peripheral(component)
        what = f"component {component} of system {system} is an autopilot too"
        return _heard_too(what, f"component {own_component}", "component") if is_rival else None

    def _is_of_gimbal(self, message_id: int, component: int) -> bool:
        return message_id in _OF_GIMBALS or is_peripheral(component)


def _gimbal(message_id: int, component: int, state: IntArray) -> str | None:
    """Which gimbal a message is of, beside the one that is followed."""
    slot = WANTED.index(message_id)
    sender = int(state[State.SENDERS + slot])
    if sender < 0:
        return None
    name, own = message_name(message_id), sender & 0xFF
    if component == own:
        what = f"{name} of component {component} is of several gimbals"
        return _heard_too(what, f"number {device_of(state, slot)}", "gimbal")
    return _heard_too(f"{name} comes from component {component} too", f"component {own}", "gimbal")


def _heard_too(what: str, own: str, key: str) -> str:
    return f"{what}: {own} was heard first and is followed; choose with telemetry.{key}"


class SequenceWatch:
    """Follows the autopilot's sequence numbers; one that is missing still is lost once 64 later ones were sent.

    A frame that is late, or comes twice, is no loss; nor is a counter that starts anew.
    """

    def __init__(self) -> None:
        self._numbers: IntArray | None = None
        self._came = np.ones(_WINDOW, dtype=np.bool_)  # which of the highest numbers came, by their remainders

    def track(self, block: RawBlock, data: Bytes, heads: IntArray, state: IntArray) -> LinkTrack | None:
        """Losses found at each of the autopilot's frames in a block.

        Args:
            block: The frames.
            data: Its bytes.
            heads: ``(5, n)`` from ``kernels.read_headers``.
            state: Of the selection, which knows the autopilot.

        Returns:
            None where the block has no frame of it.
        """
        if state[State.COMPONENT] < 0:
            return None
        is_own = (heads[0] >= 0) & (heads[1] == state[State.SYSTEM]) & (heads[2] == state[State.COMPONENT])
        if not is_own.any():
            return None
        own = slice(None) if is_own.all() else np.flatnonzero(is_own)
        start, arrival_ns = block.offset[own], block.arrival_ns[own]
        at = start + np.where(heads[3, own] - start == V2_HEAD, _V2_SEQUENCE_AT, _V1_SEQUENCE_AT)
        boot_ns = np.full(len(start), NO_BOOT_TIME, dtype=np.int64)
        return LinkTrack(arrival_ns=arrival_ns, boot_ns=boot_ns, lost=self.lost(data[at]))

    def lost(self, sequence: Bytes) -> IntArray:
        """Numbers ``(n,)`` of frames known to be lost at each of the next ones, by their sequence numbers."""
        if self._numbers is None:
            self._numbers = np.full(2, int(sequence[0]) - 1, dtype=np.int64)
        lost = np.zeros(len(sequence), dtype=np.int64)
        _follow(sequence, self._numbers, self._came, lost)
        return lost


@njit
def _follow(sequence: Bytes, numbers: IntArray, came: BoolArray, lost: IntArray) -> None:
    """``SequenceWatch.lost``; ``numbers`` are without the wrap that of the frame before, and the highest so far."""
    before, top = numbers
    for k in range(len(sequence)):
        step = (np.int64(sequence[k]) - before) % _MODULUS
        before += step if step < _MODULUS // 2 else step - _MODULUS
        if top - before >= _WINDOW:  # starts anew
            top = before - 1
            came[:] = True
        while top < before:
            top += 1
            lost[k] += not came[top % _WINDOW]
            came[top % _WINDOW] = False
        came[before % _WINDOW] = True
    numbers[0], numbers[1] = before, top


class MavlinkDecoder:
    """Decodes the wanted messages of one vehicle; a ``service.ports.TelemetryDecoder``.

    Frames before the vehicle was first heard are left out. A gimbal or sensor with a clock of its own (another
    component) gets ``NO_BOOT_TIME``: its time since boot is not the vehicle's.

    Args:
        followed: The vehicle to follow; what it does not say is the first from which an autopilot's HEARTBEAT, an
            ATTITUDE or a GLOBAL_POSITION_INT comes.

    Attributes:
        rejected: Rows left out, by ``MESSAGE: reason``.
    """

    def __init__(self, followed: FollowedIds | None = None) -> None:
        followed = followed or FollowedIds()
        self._state = fresh_state(followed)
        self._angle_scales = followed.angle_scales
        self._others = OtherSenders(followed)
        self.rejected: Counter[str] = Counter()
        self._address = SharedAddress()
        self._sequence = SequenceWatch()
        self._stuck = StuckAngles()

    @property
    def system(self) -> int | None:
        """The system that is followed; None until one was heard."""
        system = int(self._state[State.SYSTEM])
        return None if system < 0 else system

    @property
    def component(self) -> int | None:
        """The autopilot's component that is followed; None until one was heard."""
        component = int(self._state[State.COMPONENT])
        return None if component < 0 else component

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's frames, at most one a message, one a rival or failure, one of the link.

        A frame that is damaged, or not wanted, is no error.

        Raises:
            ValueError: The block is not MAVLink.
        """
        if block.protocol != WireProtocol.MAVLINK:
            raise ValueError(f"got a block of {block.protocol}, must be {WireProtocol.MAVLINK}")
        data = np.frombuffer(block.data, dtype=np.uint8)
        block, heads = self._address.own_frames(block, headers(block), self._state, self.rejected)
        slots = np.empty(heads.shape[1], dtype=np.int64)
        before = self._state.copy()
        select(data, heads, SLOTS, self._state, slots)
        self._note_others(before)
        order = np.argsort(slots.astype(np.int8), kind="stable")  # of few values, which is fast
        ends = np.cumsum(np.bincount(slots + 1, minlength=len(WANTED) + 1))
        tracks = (
            track
            for slot, (start, stop) in enumerate(pairwise(ends.tolist()))
            if stop > start
            for track in self._tracks(slot, order[start:stop], heads, block)
            if len(track.arrival_ns)
        )
        link = self._sequence.track(block, data, heads, self._state)
        rivals = self._others.tracks(block, heads, slots, self._state)
        return (*tracks, *rivals) if link is None else (*tracks, link, *rivals)

    def _note_others(self, before: IntArray) -> None:
        """Count what came of other gimbals and sensors, and of those that look elsewhere, since the state was that."""
        aside = int(self._state[State.LOOKS_ASIDE] - before[State.LOOKS_ASIDE])
        if aside:
            self.rejected[f"{message_name(DISTANCE_SENSOR)}: does not look down"] += aside
        for counter, message_id, what in (
            (State.OTHER_GIMBALS, GIMBAL_DEVICE_ATTITUDE_STATUS, "gimbal"),
            (State.OTHER_SENSORS, DISTANCE_SENSOR, "sensor"),
        ):
            count = int(self._state[counter] - before[counter])
            if count:
                number = device_of(self._state, WANTED.index(message_id))
                self.rejected[f"{message_name(message_id)}: of another {what} than number {number}"] += count

    def _tracks(self, slot: int, index: IntArray, heads: IntArray, block: RawBlock) -> Iterator[Track]:
        """The tracks of one message's rows."""
        message_id = WANTED[slot]
        payload = payload_rows(block, heads[3:, index], _DTYPES[message_id])
        component = heads[2, index]
        boot_ns = np.where(component == self._state[State.COMPONENT], boot_ns_of(payload), NO_BOOT_TIME)
        if message_id in OF_CAMERAS:
            number_cameras(payload, component)
        name = message_name(message_id)
        scale = self._angle_scales.get(name, NO_SCALE)
        rows = Rows(name, payload, block.arrival_ns[index], boot_ns, {}, scale)
        if message_id == ATTITUDE:
            stuck = {"stands still while its rates say that it turns": self._stuck.mask(rows)}
            rows = rows.accepted(self.rejected, stuck)
        yield _MAKERS[message_id](rows, self.rejected)
        if message_id == GIMBAL_DEVICE_ATTITUDE_STATUS:
            yield from gimbal_failure_tracks(rows)
        elif message_id == GLOBAL_POSITION_INT:
            yield heading_track(rows)
        elif message_id == GPS_RAW_INT:
            yield receiver_track(rows)
