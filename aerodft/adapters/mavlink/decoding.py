"""MAVLink frames to telemetry tracks; whose they are, and what of them was lost."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from aerodft.adapters.mavlink import rows as to
from aerodft.adapters.mavlink import selection as pick
from aerodft.adapters.mavlink.dialect import TABLE_IDS, message_name, payload_dtype
from aerodft.adapters.mavlink.framing import headers, payload_rows
from aerodft.adapters.mavlink.kernels import V2_HEAD, Bytes
from aerodft.conventions import SECOND_NS
from aerodft.geometry.jit import njit
from aerodft.model.arrays import BoolArray, IntArray
from aerodft.model.health import LinkTrack, RivalTrack
from aerodft.model.telemetry import NO_BOOT_TIME, RawBlock, Track, WireProtocol

OF_ANOTHER_ADDRESS: Final = "frames: with the autopilot's ids, from another address"
_SILENCE_NS: Final = SECOND_NS  # of the followed address, before another one is taken for its successor
_OF_VEHICLES: Final = (pick.ATTITUDE, pick.GLOBAL_POSITION_INT)
_OF_GIMBALS: Final = (pick.MOUNT_STATUS, pick.MOUNT_ORIENTATION, pick.GIMBAL_DEVICE_ATTITUDE_STATUS)
_V1_SEQUENCE_AT, _V2_SEQUENCE_AT = 2, 4
_MODULUS: Final = 256
_WINDOW: Final = 64  # frames: what is that far behind is not late, but of a counter that started anew
_MAKERS: Final[dict[int, Callable[[to.Rows, Counter[str]], Track]]] = {
    pick.SYSTEM_TIME: to.clock_track,
    pick.ATTITUDE: to.vehicle_track,
    pick.GLOBAL_POSITION_INT: to.position_track,
    pick.DISTANCE_SENSOR: to.distance_sensor_track,
    pick.TERRAIN_REPORT: to.terrain_track,
    pick.ALTITUDE: to.altitude_track,
    pick.MOUNT_STATUS: to.mount_status_track,
    pick.RANGEFINDER: to.rangefinder_track,
    pick.MOUNT_ORIENTATION: to.mount_orientation_track,
    pick.GIMBAL_DEVICE_ATTITUDE_STATUS: to.gimbal_device_track,
    pick.TIMESYNC: to.sync_track,
    pick.HEARTBEAT: to.heartbeat_track,
    pick.GPS_RAW_INT: to.gps_track,
    pick.EKF_STATUS_REPORT: to.ekf_track,
    pick.ESTIMATOR_STATUS: to.estimator_track,
    pick.CAMERA_SETTINGS: to.settings_track,
    pick.VIDEO_STREAM_INFORMATION: to.video_stream_track,
    pick.CAMERA_FOV_STATUS: to.fov_track,
}
_DTYPES: Final = {message_id: payload_dtype(message_id) for message_id in _MAKERS}


class OneAddress:
    """Leaves out what a second address says in the name of the autopilot, while the first goes on.

    Addresses that follow each other are one sender: a bridge that reconnects, or that opens a port for every datagram
    and so never speaks twice from the same. A gimbal or a camera may have an address of its own.
    """

    def __init__(self) -> None:
        self._followed: str | None = None
        self._last_ns = 0
        self._spoke_again = False

    def kept(
        self, block: RawBlock, heads: IntArray, state: IntArray, rejected: Counter[str]
    ) -> tuple[RawBlock, IntArray]:
        """A block and its headers ``(5, n)``, without what is of somebody else.

        Args:
            block: Frames of one sender.
            heads: From ``kernels.read_headers``.
            state: Of the selection, which knows the autopilot.
            rejected: Counts what is left out.
        """
        if state[pick.COMPONENT] < 0:
            return block, heads
        own = (heads[0] >= 0) & (heads[1] == state[pick.SYSTEM]) & (heads[2] == state[pick.COMPONENT])
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


class Rivals:
    """Names whoever else could have been followed: other vehicles, autopilots and gimbals.

    Args:
        followed: What was chosen; of that there are no rivals.
    """

    def __init__(self, followed: pick.Followed) -> None:
        self._followed = followed

    def tracks(self, block: RawBlock, heads: IntArray, slots: IntArray, state: IntArray) -> Iterator[RivalTrack]:
        """One track for each of them that spoke in a block.

        Args:
            block: The frames.
            heads: ``(5, n)`` their headers.
            slots: ``(n,)`` which were selected: -1 for what was left out.
            state: Of the selection, which knows who is followed.
        """
        if state[pick.COMPONENT] < 0:
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
                yield RivalTrack(arrival_ns=block.arrival_ns[rows], boot_ns=none, what=what)

    def _sentence(self, message_id: int, system: int, component: int, state: IntArray) -> str | None:
        """Who sent a message that was left out; None where it is nobody who could have been meant."""
        own_system, own_component = int(state[pick.SYSTEM]), int(state[pick.COMPONENT])
        if system != own_system:
            is_rival = self._followed.system is None and not self._is_of_gimbal(message_id, component)
            other, own, key = f"system {system}", f"system {own_system}", "system"
            return _heard_too(f"{other} is on the link too", own, key) if is_rival else None
        if message_id in _OF_GIMBALS:
            return None if self._followed.gimbal is not None else _gimbal(message_id, component, state)
        is_rival = component != own_component and self._followed.component is None and not pick.is_peripheral(component)
        what = f"component {component} of system {system} is an autopilot too"
        return _heard_too(what, f"component {own_component}", "component") if is_rival else None

    def _is_of_gimbal(self, message_id: int, component: int) -> bool:
        return message_id in _OF_GIMBALS or pick.is_peripheral(component)


def _gimbal(message_id: int, component: int, state: IntArray) -> str | None:
    """Which gimbal a message is of, beside the one that is followed."""
    slot = pick.WANTED.index(message_id)
    sender = int(state[pick.LOCKS + slot])
    if sender < 0:
        return None
    name, own = message_name(message_id), sender & 0xFF
    if component == own:
        what = f"{name} of component {component} is of several gimbals"
        return _heard_too(what, f"number {pick.device_of(state, slot)}", "gimbal")
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
        """What was found to be lost at each of the autopilot's frames in a block.

        Args:
            block: The frames.
            data: Its bytes.
            heads: ``(5, n)`` from ``kernels.read_headers``.
            state: Of the selection, which knows the autopilot.

        Returns:
            None where the block has no frame of it.
        """
        if state[pick.COMPONENT] < 0:
            return None
        is_own = (heads[0] >= 0) & (heads[1] == state[pick.SYSTEM]) & (heads[2] == state[pick.COMPONENT])
        if not is_own.any():
            return None
        own = slice(None) if is_own.all() else np.flatnonzero(is_own)
        start, arrival_ns = block.offset[own], block.arrival_ns[own]
        at = start + np.where(heads[3, own] - start == V2_HEAD, _V2_SEQUENCE_AT, _V1_SEQUENCE_AT)
        boot_ns = np.full(len(start), NO_BOOT_TIME, dtype=np.int64)
        return LinkTrack(arrival_ns=arrival_ns, boot_ns=boot_ns, lost=self.lost(data[at]))

    def lost(self, sequence: Bytes) -> IntArray:
        """How many frames are known to be lost at each of the next ones, by their numbers ``(n,)``."""
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

    def __init__(self, followed: pick.Followed | None = None) -> None:
        followed = followed or pick.Followed()
        self._state = pick.fresh_state(followed)
        self._rivals = Rivals(followed)
        self.rejected: Counter[str] = Counter()
        self._address = OneAddress()
        self._sequence = SequenceWatch()

    @property
    def system(self) -> int | None:
        """The system that is followed; None until one was heard."""
        system = int(self._state[pick.SYSTEM])
        return None if system < 0 else system

    @property
    def component(self) -> int | None:
        """The autopilot's component that is followed; None until one was heard."""
        component = int(self._state[pick.COMPONENT])
        return None if component < 0 else component

    @property
    def damaged(self) -> int:
        """Frames that failed the framer's check."""
        return int(self._state[pick.DAMAGED])

    def decode(self, block: RawBlock) -> tuple[Track, ...]:
        """The tracks of this block's frames, at most one a message, one a rival or failure, one of the link.

        A frame that is damaged, or not wanted, is no error.

        Raises:
            ValueError: The block is not MAVLink.
        """
        if block.protocol is not WireProtocol.MAVLINK:
            raise ValueError(f"got a block of {block.protocol}, must be {WireProtocol.MAVLINK}")
        data = np.frombuffer(block.data, dtype=np.uint8)
        block, heads = self._address.kept(block, headers(block), self._state, self.rejected)
        slots = np.empty(heads.shape[1], dtype=np.int64)
        before = self._state.copy()
        pick.select(data, heads, pick.SLOTS, self._state, slots)
        self._note_others(before)
        order = np.argsort(slots.astype(np.int8), kind="stable")  # of few values, which is fast
        ends = np.cumsum(np.bincount(slots + 1, minlength=len(pick.WANTED) + 1))
        tracks = (
            track
            for slot, (start, stop) in enumerate(pairwise(ends.tolist()))
            if stop > start
            for track in self._tracks(slot, order[start:stop], heads, block)
            if len(track.arrival_ns)
        )
        link = self._sequence.track(block, data, heads, self._state)
        rivals = self._rivals.tracks(block, heads, slots, self._state)
        return (*tracks, *rivals) if link is None else (*tracks, link, *rivals)

    def _note_others(self, before: IntArray) -> None:
        """Count what came of other gimbals and sensors, and of those that look elsewhere, since the state was that."""
        aside = int(self._state[pick.LOOKS_ASIDE] - before[pick.LOOKS_ASIDE])
        if aside:
            self.rejected[f"{message_name(pick.DISTANCE_SENSOR)}: does not look down"] += aside
        for counter, message_id, what in (
            (pick.OTHER_GIMBALS, pick.GIMBAL_DEVICE_ATTITUDE_STATUS, "gimbal"),
            (pick.OTHER_SENSORS, pick.DISTANCE_SENSOR, "sensor"),
        ):
            count = int(self._state[counter] - before[counter])
            if count:
                number = pick.device_of(self._state, pick.WANTED.index(message_id))
                self.rejected[f"{message_name(message_id)}: of another {what} than number {number}"] += count

    def _tracks(self, slot: int, index: IntArray, heads: IntArray, block: RawBlock) -> Iterator[Track]:
        """The tracks of one message's rows."""
        message_id = pick.WANTED[slot]
        payload = payload_rows(block, heads[3:, index], _DTYPES[message_id])
        component = heads[2, index]
        boot_ns = np.where(component == self._state[pick.COMPONENT], to.boot_ns_of(payload), NO_BOOT_TIME)
        if message_id in pick.OF_CAMERAS:
            to.number_cameras(payload, component)
        rows = to.Rows(message_name(message_id), payload, block.arrival_ns[index], boot_ns, {})
        yield _MAKERS[message_id](rows, self.rejected)
        if message_id == pick.GIMBAL_DEVICE_ATTITUDE_STATUS:
            yield from to.gimbal_failure_tracks(rows)
