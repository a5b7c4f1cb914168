"""Which messages, how often: what a survey lacks, as requests to the vehicle and as its autopilot's parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.mavlink import selection as pick
from aerodft.adapters.mavlink.dialect import message_name
from aerodft.adapters.mavlink.link import OWN_COMPONENT, OWN_SYSTEM
from aerodft.adapters.mavlink.streams import Stream

ARDUPILOT: Final = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
PX4: Final = dialect.MAV_AUTOPILOT_PX4
_SLOW: Final = 0.8  # of the wanted rate
_SECOND_US: Final = 1_000_000
_WAYS: Final = {"ardupilot": "for ArduPilot set", "px4": "for PX4 put"}
_GIMBALS: Final = frozenset({"GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION"})


@dataclass(frozen=True, slots=True)
class _Wanted:
    """A message, how often it is wanted, and ArduPilot's group of it (empty: on request alone)."""

    message_id: int
    rate_hz: float
    group: str
    autopilots: tuple[int, ...] = (ARDUPILOT, PX4)


_CATALOGUE: Final = (
    _Wanted(pick.SYSTEM_TIME, 1, "EXTRA3"),
    _Wanted(pick.ATTITUDE, 10, "EXTRA1"),
    _Wanted(pick.GLOBAL_POSITION_INT, 5, "POSITION"),
    _Wanted(pick.GIMBAL_DEVICE_ATTITUDE_STATUS, 10, "EXTRA3"),
    _Wanted(pick.DISTANCE_SENSOR, 5, "EXTRA3"),
    _Wanted(pick.TERRAIN_REPORT, 1, "EXTRA3", (ARDUPILOT,)),
    _Wanted(pick.ALTITUDE, 5, "", (PX4,)),
    _Wanted(pick.GPS_RAW_INT, 1, "EXT_STAT"),
    _Wanted(pick.EKF_STATUS_REPORT, 1, "EXTRA3", (ARDUPILOT,)),
    _Wanted(pick.ESTIMATOR_STATUS, 1, "", (PX4,)),
    _Wanted(pick.CAMERA_FOV_STATUS, 1, "", (ARDUPILOT,)),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageRequest:
    """One message that should come more often.

    Attributes:
        message_id: Its id.
        rate_hz: Wanted.
        now_hz: As it comes; 0 where it does not.
        system: Whom to ask.
        component: Of it: who sends the message now, else the autopilot.
        autopilot: MAV_AUTOPILOT; None where not known.
        group: ArduPilot's stream of it; empty where it comes on request alone.
    """

    message_id: int
    rate_hz: float
    now_hz: float
    system: int
    component: int
    autopilot: int | None
    group: str

    @property
    def name(self) -> str:
        """The message's name."""
        return message_name(self.message_id)

    @property
    def interval_us(self) -> int:
        """The wanted interval."""
        return round(_SECOND_US / self.rate_hz)

    @property
    def parameters(self) -> dict[str, str]:
        """What to set instead, by autopilot."""
        ways = {}
        if self.autopilot != PX4 and self.group:
            ways["ardupilot"] = f"SR0_{self.group} = {self.rate_hz:g} (MAV1_{self.group} from 4.7 on)"
        if self.autopilot != ARDUPILOT:
            stream = f"mavlink stream -d DEVICE -s {self.name} -r {self.rate_hz:g}"
            ways["px4"] = f"{stream} in etc/extras.txt (MAV_0_MODE chooses the set of messages, MAV_0_RATE its limit)"
        return ways

    def sentence(self) -> str:
        """What is wrong, and what to do."""
        comes = f"comes at {self.now_hz:.1f} Hz" if self.now_hz else "does not come"
        ways = [
            f"request it (--fix, or MAV_CMD_SET_MESSAGE_INTERVAL with {self.message_id} and {self.interval_us} us)",
            *(f"{_WAYS[name]} {how}" for name, how in self.parameters.items()),
        ]
        return f"{self.name} {comes}, {self.rate_hz:g} Hz is wanted: {', or '.join(ways)}"

    def document(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "message": self.name,
            "message_id": self.message_id,
            "rate_hz": self.rate_hz,
            "now_hz": round(self.now_hz, 3),
            "interval_us": self.interval_us,
            "system": self.system,
            "component": self.component,
            "parameters": self.parameters,
        }

    def command(self, attempt: int = 0) -> bytes:
        """The request as an unsigned MAVLink 2 frame of a ground station.

        Args:
            attempt: How often it was sent before.
        """
        message = dialect.MAVLink_command_long_message(
            self.system,
            self.component,
            dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
            attempt,
            self.message_id,
            self.interval_us,
            *(0.0,) * 5,
        )
        return bytes(message.pack(dialect.MAVLink(None, srcSystem=OWN_SYSTEM, srcComponent=OWN_COMPONENT)))


def wanted(
    streams: Sequence[Stream], *, system: int | None, component: int | None, autopilot: int | None
) -> tuple[MessageRequest, ...]:
    """What a vehicle should send more often than it does.

    Args:
        streams: All that came.
        system: The vehicle that is followed; None where there is none, or in an on-board log.
        component: Its autopilot.
        autopilot: MAV_AUTOPILOT; None where not known.
    """
    if system is None or component is None:
        return ()
    own = {stream.name: stream for stream in streams if stream.system == system}
    known = autopilot if autopilot in {ARDUPILOT, PX4} else None
    return tuple(
        MessageRequest(
            message_id=each.message_id,
            rate_hz=each.rate_hz,
            now_hz=_rate_hz(own, message_name(each.message_id)),
            system=system,
            component=_sender(own, message_name(each.message_id), component),
            autopilot=known,
            group=each.group,
        )
        for each in _CATALOGUE
        if (known is None or known in each.autopilots) and _is_slow(own, each)
    )


def _is_slow(own: dict[str, Stream], each: _Wanted) -> bool:
    name = message_name(each.message_id)
    names = _GIMBALS if name in _GIMBALS else {name}
    return max(_rate_hz(own, other) for other in names) < _SLOW * each.rate_hz


def _rate_hz(own: dict[str, Stream], name: str) -> float:
    return own[name].rate_hz if name in own else 0.0


def _sender(own: dict[str, Stream], name: str, autopilot: int) -> int:
    component = own[name].component if name in own else None
    return autopilot if component is None else component
