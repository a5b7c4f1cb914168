"""MAVLink frames to telemetry tracks."""

from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Final

import numpy as np

from aerodft.adapters.mavlink import camera_rows as cameras
from aerodft.adapters.mavlink import health_rows as health
from aerodft.adapters.mavlink import rows as to
from aerodft.adapters.mavlink import selection as pick
from aerodft.adapters.mavlink.blocks import headers, payload_rows
from aerodft.adapters.mavlink.dialect import message_name, payload_dtype
from aerodft.adapters.mavlink.one_address import OneAddress
from aerodft.adapters.mavlink.rivals import Rivals
from aerodft.adapters.mavlink.sequence import SequenceWatch
from aerodft.model.arrays import IntArray
from aerodft.model.telemetry import NO_BOOT_TIME, RawBlock, Track, WireProtocol

_MAKERS: Final[dict[int, Callable[[to.Rows, Counter[str]], Track | None]]] = {
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
    pick.HEARTBEAT: health.heartbeat_track,
    pick.GPS_RAW_INT: health.gps_track,
    pick.EKF_STATUS_REPORT: health.ekf_track,
    pick.ESTIMATOR_STATUS: health.estimator_track,
    pick.CAMERA_SETTINGS: cameras.settings_track,
    pick.VIDEO_STREAM_INFORMATION: cameras.video_stream_track,
    pick.CAMERA_FOV_STATUS: cameras.fov_track,
}
_DTYPES: Final = {message_id: payload_dtype(message_id) for message_id in _MAKERS}

_NOTHING: Final = np.zeros(0, dtype=np.int64)
_EMPTY: Final = RawBlock(
    protocol=WireProtocol.MAVLINK, sender="", arrival_ns=_NOTHING, offset=_NOTHING, length=_NOTHING, data=b""
)


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

    def warm_up(self) -> None:
        """Compile now what would hold up the first frames: on the very first run that takes seconds."""
        self.decode(_EMPTY)

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
            if stop > start and pick.WANTED[slot] in _MAKERS
            for track in self._tracks(slot, order[start:stop], heads, block)
        )
        link = self._sequence.track(block, data, heads, self._state)
        rivals = self._rivals.tracks(block, heads, slots, self._state)
        return tuple(track for track in (*tracks, link, *rivals) if track is not None)

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

    def _tracks(self, slot: int, index: IntArray, heads: IntArray, block: RawBlock) -> Iterator[Track | None]:
        """The tracks of one message's rows."""
        message_id = pick.WANTED[slot]
        payload = payload_rows(block, heads[3:, index], _DTYPES[message_id])
        component = heads[2, index]
        boot_ns = np.where(component == self._state[pick.COMPONENT], to.boot_ns_of(payload), NO_BOOT_TIME)
        if message_id in pick.OF_CAMERAS:
            cameras.number(payload, component)
        rows = to.Rows(message_name(message_id), payload, block.arrival_ns[index], boot_ns)
        yield _MAKERS[message_id](rows, self.rejected)
        if message_id == pick.GIMBAL_DEVICE_ATTITUDE_STATUS:
            yield from health.gimbal_failure_tracks(rows)
