"""Which messages, how often: what a survey lacks, as requests to the vehicle and its cameras; and asking for them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry import MOST_ATTACHED, mavlink
from aerodft.conventions import SECOND_NS
from aerodft.diagnosis.streams import Parameters, Stream
from aerodft.model import IntArray, RawBlock, ZoomSource
from aerodft.service import Batches, ZoomSettings

ARDUPILOT: Final = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
PX4: Final = dialect.MAV_AUTOPILOT_PX4
_SLOW: Final = 0.8  # of the wanted rate
_SECOND_US: Final = 1_000_000
_WAYS: Final = {"ardupilot": "for ArduPilot set", "px4": "for PX4 put"}
_OF_AUTOPILOT: Final = frozenset(map(mavlink.message_name, mavlink.OF_AUTOPILOT))
_GIMBALS: Final = frozenset({"GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION"})
_PORTS: Final = {"SR0": "USB", "SR1": "TELEM1", "SR2": "TELEM2"}
# What a vehicle without it has set to 0, by message: the type of every instance, by its names of all versions.
SWITCHED_OFF_BY: Final = {
    "GIMBAL_DEVICE_ATTITUDE_STATUS": ("MNT[12]?_TYPE",),
    "MOUNT_STATUS": ("MNT[12]?_TYPE",),
    "DISTANCE_SENSOR": ("RNGFND[1-9A]?_TYPE",),
    "TERRAIN_REPORT": ("TERRAIN_ENABLE",),
}
_OLD_MOUNT: Final = "MNT_TYPE"  # MNT1_TYPE since the firmware knows GIMBAL_DEVICE_ATTITUDE_STATUS
_CAMERA_RATE_HZ: Final = 1.0
_CAMERA_COMPONENTS: Final = range(dialect.MAV_COMP_ID_CAMERA, dialect.MAV_COMP_ID_CAMERA6 + 1)
_CAMERA_IDS: Final = {
    ZoomSource.CAMERA_SETTINGS: mavlink.CAMERA_SETTINGS,
    ZoomSource.CAMERA_FOV_STATUS: mavlink.CAMERA_FOV_STATUS,
    ZoomSource.VIDEO_STREAM_INFORMATION: mavlink.VIDEO_STREAM_INFORMATION,
}
_CAMERA_MESSAGES: Final = frozenset(map(str, _CAMERA_IDS))
_CAMERA_MESSAGES_OF_ARDUPILOT: Final = (ZoomSource.CAMERA_SETTINGS, ZoomSource.CAMERA_FOV_STATUS)
_ATTEMPTS: Final = 3
_PATIENCE_NS: Final = SECOND_NS
_COMMAND_ACK: Final = dialect.MAVLINK_MSG_ID_COMMAND_ACK
_ACK: Final = mavlink.payload_dtype(_COMMAND_ACK)
_ANSWERS: Final = {
    dialect.MAV_RESULT_ACCEPTED: "accepted",
    dialect.MAV_RESULT_TEMPORARILY_REJECTED: "denied for now",
    dialect.MAV_RESULT_DENIED: "denied",
    dialect.MAV_RESULT_UNSUPPORTED: "unsupported",
    dialect.MAV_RESULT_FAILED: "failed",
}
_NO_ANSWER: Final = "no answer"
_Senders = dict[tuple[int, int], str]  # by system and component


@dataclass(frozen=True, slots=True)
class _CatalogueEntry:
    """A message, how often it is wanted, ArduPilot's group of it (empty: none), and what must be set for it to come."""

    message_id: int
    rate_hz: float
    group: str
    autopilots: tuple[int, ...] = (ARDUPILOT, PX4)
    needs: str = ""

    @property
    def name(self) -> str:
        """The message's name."""
        return mavlink.message_name(self.message_id)


# ArduPilot's groups are the STREAM_*_msgs of its GCS_MAVLink_Parameters.cpp: SRn_ of port n counted from 0, from 4.7 on
# MAVn_ counted from 1 (early 4.7-dev still had SRn_), read at start-up. PX4's names of streams are those of its
# mavlink_main.cpp; system_startup.md describes extras.txt, module.yaml MAV_0_MODE and MAV_0_RATE.
_CATALOGUE: Final = (
    _CatalogueEntry(mavlink.SYSTEM_TIME, 1, "EXTRA3"),
    _CatalogueEntry(mavlink.ATTITUDE, 10, "EXTRA1"),
    _CatalogueEntry(mavlink.GLOBAL_POSITION_INT, 5, "POSITION"),
    _CatalogueEntry(mavlink.GIMBAL_DEVICE_ATTITUDE_STATUS, 10, "EXTRA3", needs="MNT1_TYPE set to the gimbal's"),
    _CatalogueEntry(
        mavlink.DISTANCE_SENSOR, 5, "EXTRA3", needs="RNGFND1_TYPE set to the sensor's and RNGFND1_ORIENT = 25"
    ),
    _CatalogueEntry(mavlink.TERRAIN_REPORT, 1, "EXTRA3", (ARDUPILOT,), needs="TERRAIN_ENABLE = 1"),
    _CatalogueEntry(mavlink.ALTITUDE, 5, "", (PX4,)),
    _CatalogueEntry(mavlink.GPS_RAW_INT, 1, "EXT_STAT"),
    _CatalogueEntry(mavlink.EKF_STATUS_REPORT, 1, "EXTRA3", (ARDUPILOT,)),
    _CatalogueEntry(mavlink.ESTIMATOR_STATUS, 1, "", (PX4,)),
)
# Which of them tell a port by its rates: what autopilots send of a group whatever is fitted.
_OF_PORT: Final = frozenset({mavlink.SYSTEM_TIME, mavlink.ATTITUDE, mavlink.GLOBAL_POSITION_INT, mavlink.GPS_RAW_INT})
_MOUNT_STATUS: Final = mavlink.message_name(mavlink.MOUNT_STATUS)


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageRequest:
    """One message that should come more often.

    Attributes:
        message_id: Its id.
        rate_hz: Wanted; None for once, of who says it again by itself when it changes.
        now_hz: As it comes; 0 where it does not.
        system: Whom to ask.
        component: Of it: who sends the message now, else the autopilot, or a camera.
        autopilot: MAV_AUTOPILOT of whom is asked; None where not known.
        group: ArduPilot's stream of it; empty where it comes on request alone.
        group_hz: What that must be set to, so that all that is wanted of it comes.
        needs: What ArduPilot must be set to besides; empty for nothing.
        port: ArduPilot's name of the port that the link is on; empty where not known.
    """

    message_id: int
    rate_hz: float | None
    now_hz: float
    system: int
    component: int
    autopilot: int | None
    group: str = ""
    group_hz: float = 0.0
    needs: str = ""
    port: str = ""

    @property
    def name(self) -> str:
        """The message's name."""
        return mavlink.message_name(self.message_id)

    @property
    def interval_us(self) -> int | None:
        """The wanted interval; None for once."""
        return None if self.rate_hz is None else round(_SECOND_US / self.rate_hz)

    @property
    def command_id(self) -> int:
        """The MAV_CMD that asks for it."""
        return int(dialect.MAV_CMD_REQUEST_MESSAGE if self.rate_hz is None else dialect.MAV_CMD_SET_MESSAGE_INTERVAL)

    @property
    def rate_text(self) -> str:
        """Words for the wanted rate."""
        return "once" if self.rate_hz is None else f"at {self.rate_hz:g} Hz"

    @property
    def parameters(self) -> dict[str, str]:
        """Parameters that have the same effect, by autopilot."""
        ways = {}
        if self.autopilot != PX4 and self.group:
            needs = f"; it needs {self.needs}" if self.needs else ""
            ways["ardupilot"] = f"{self._rate_parameter} and restart it{needs}"
        if self.autopilot != ARDUPILOT and self.rate_hz is not None:
            ways["px4"] = (
                f"mavlink stream -d DEVICE -s {self.name} -r {self.rate_hz:g} (-u PORT on UDP) in etc/extras.txt of "
                "its SD card (MAV_0_MODE chooses the set of messages, MAV_0_RATE limits all of them in bytes a second)"
            )
        return ways

    @property
    def _rate_parameter(self) -> str:
        """ArduPilot's parameter of the group's rate, set to what is wanted, and which port that is of."""
        if self.port:
            called = f", usually {_PORTS[self.port]}" if self.port in _PORTS else ""
            return (
                f"{self.port}_{self.group} = {self.group_hz:g} ({self.port} is this link's port by its rates{called})"
            )
        ports = ", ".join(f"{port} {called}" for port, called in _PORTS.items())
        return (
            f"SRn_{self.group} = {self.group_hz:g} of the port that this link is on ({ports}; from 4.7 on "
            f"MAVn_{self.group}, the first port being MAV1)"
        )

    def sentence(self, *, is_live: bool) -> str:
        """Sentence on the message, and what to do: at once on a link, before the next flight for a log."""
        settings = [f"{_WAYS[name]} {how}" for name, how in self.parameters.items()]
        if not is_live:
            came = f"came at {self.now_hz:.1f} Hz" if self.now_hz else "did not come"
            advice = ", or ".join(settings) or "request it on the link"
            return f"{self.name} {came}, it is wanted {self.rate_text}: before the next flight, {advice}"
        comes = f"comes at {self.now_hz:.1f} Hz" if self.now_hz else "does not come"
        if self.rate_hz is None:
            command = f"MAV_CMD_REQUEST_MESSAGE with {self.message_id}"
        else:
            command = f"MAV_CMD_SET_MESSAGE_INTERVAL with {self.message_id} and {self.interval_us} us"
        ways = [
            f"request it from component {self.component} (`request_messages`, or {command})",
            *settings,
        ]
        return f"{self.name} {comes}, it is wanted {self.rate_text}: {', or '.join(ways)}"

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
            self.command_id,
            attempt,
            self.message_id,
            self.interval_us or 0,  # asked for once: 0 for all video streams
            *(0.0,) * 5,
        )
        return bytes(
            message.pack(dialect.MAVLink(None, srcSystem=mavlink.OWN_SYSTEM, srcComponent=mavlink.OWN_COMPONENT))
        )


def missing_messages(
    streams: Sequence[Stream],
    *,
    system: int | None,
    component: int | None,
    autopilot: int | None,
    parameters: Parameters | None = None,
) -> tuple[MessageRequest, ...]:
    """Messages that a vehicle should send more often; not those that its parameters switch off.

    Args:
        streams: All that came.
        system: The vehicle that is followed; None where there is none, or in an on-board log.
        component: Its autopilot.
        autopilot: MAV_AUTOPILOT; None where not known.
        parameters: What the autopilot said of its parameters.
    """
    if system is None or component is None:
        return ()
    parameters = parameters or Parameters()
    own = _heard(streams, system, component)
    known = autopilot if autopilot in {ARDUPILOT, PX4} else None
    port = parameters.port({each.group: _rate_hz(own, each.name) for each in _CATALOGUE if each.message_id in _OF_PORT})
    requests = [
        MessageRequest(
            message_id=each.message_id,
            rate_hz=each.rate_hz,
            now_hz=_rate_hz(own, each.name),
            system=system,
            component=_sender(own, each.name, component),
            autopilot=known,
            group=each.group,
            group_hz=each.rate_hz,
            needs=each.needs,
            port=port,
        )
        for each in _catalogue(own, parameters)
        if (known is None or known in each.autopilots) and _is_slow(own, each)
    ]
    group_hz = {each.group: max(other.group_hz for other in requests if other.group == each.group) for each in requests}
    return tuple(replace(each, group_hz=group_hz[each.group]) for each in requests)


def _catalogue(own: dict[str, Stream], parameters: Parameters) -> Iterator[_CatalogueEntry]:
    """Messages that this vehicle can send: none that is switched off, of an old firmware the old gimbal message."""
    for each in _CATALOGUE:
        is_gimbal = each.message_id == mavlink.GIMBAL_DEVICE_ATTITUDE_STATUS
        is_old = is_gimbal and each.name not in own and (_OLD_MOUNT in parameters.values or _MOUNT_STATUS in own)
        if not parameters.switch_off(*SWITCHED_OFF_BY.get(each.name, ())):
            yield replace(each, message_id=mavlink.MOUNT_STATUS, needs="") if is_old else each


def _heard(streams: Sequence[Stream], system: int, autopilot: int) -> dict[str, Stream]:
    """Senders of a system by message: only the autopilot for its own, else whoever sends it most often."""
    of_system = sorted((each for each in streams if each.system == system), key=lambda each: each.rate_hz)
    return {each.name: each for each in of_system if each.component == autopilot or each.name not in _OF_AUTOPILOT}


def _is_slow(own: dict[str, Stream], each: _CatalogueEntry) -> bool:
    names = _GIMBALS if each.name in _GIMBALS else {each.name}
    return max(_rate_hz(own, other) for other in names) < _SLOW * each.rate_hz


def _rate_hz(own: dict[str, Stream], name: str) -> float:
    return own[name].rate_hz if name in own else 0.0


def _sender(own: dict[str, Stream], name: str, autopilot: int) -> int:
    component = own[name].component if name in own else None
    return autopilot if component is None else component


def missing_camera_messages(
    streams: Sequence[Stream], *, system: int | None, component: int | None, autopilot: int | None, zoom: ZoomSettings
) -> Iterator[MessageRequest]:
    """Messages on their view that cameras should send: of each source before the first that they use.

    A camera is asked for each once, as MAVLink's camera protocol has it: it says by itself when it zooms. ArduPilot
    says what it knows of the cameras that it speaks for as often as it is told to, and nothing of their video streams.

    Args:
        streams: All that came.
        system: The vehicle that is followed; None where there is none, or in an on-board log.
        component: Its autopilot.
        autopilot: MAV_AUTOPILOT; None where not known.
        zoom: How a station reads its camera's view.
    """
    if system is None or component is None:
        return
    heard = {(each.name, each.component) for each in streams if each.system == system and each.component is not None}
    for camera in sorted(_cameras(heard, component, autopilot, zoom)):
        is_autopilot = camera == component
        for source in filter(_CAMERA_IDS.__contains__, zoom.order):
            if (str(source), camera) in heard:
                break
            if not is_autopilot or source in _CAMERA_MESSAGES_OF_ARDUPILOT:
                yield MessageRequest(
                    message_id=_CAMERA_IDS[source],
                    rate_hz=_CAMERA_RATE_HZ if is_autopilot else None,
                    now_hz=0.0,
                    system=system,
                    component=camera,
                    autopilot=autopilot if is_autopilot else None,
                )


def _cameras(heard: set[tuple[str, int]], component: int, autopilot: int | None, zoom: ZoomSettings) -> set[int]:
    """Components to ask: those that are cameras or speak for some, or the one that a station needs."""
    speakers = {who for name, who in heard if name in _CAMERA_MESSAGES or who in _CAMERA_COMPONENTS}
    if zoom.camera is not None:
        cameras = {zoom.camera if zoom.camera > MOST_ATTACHED else component}
    elif speakers or not (zoom.curve or zoom.reported_hfov_rad):
        cameras = speakers
    else:
        cameras = {component if autopilot == ARDUPILOT else _CAMERA_COMPONENTS.start}
    return cameras if autopilot == ARDUPILOT else cameras - {component}


@dataclass(frozen=True, slots=True)
class RequestOutcome:
    """A request, its answer, and the message's rate afterwards.

    Attributes:
        request: The request.
        answer: ``accepted``, ``denied``, ``unsupported``, ..., or ``no answer``.
        after_hz: The message's rate afterwards.
        count: How often it came since.
    """

    request: MessageRequest
    answer: str
    after_hz: float = 0.0
    count: int = 0

    def with_effect(self, streams: Iterable[Stream]) -> "RequestOutcome":
        """The outcome with rate and count of the requested message among streams heard afterwards."""
        sender = (self.request.name, self.request.system, self.request.component)
        stream = next((each for each in streams if (each.name, each.system, each.component) == sender), None)
        return self if stream is None else replace(self, after_hz=stream.rate_hz, count=stream.count)

    def document(self) -> dict[str, Any]:
        """Plain JSON values."""
        request = self.request.document()
        return {key: request[key] for key in ("message", "message_id", "system", "component", "rate_hz")} | {
            "answer": self.answer,
            "before_hz": request["now_hz"],
            "after_hz": round(self.after_hz, 3),
            "count": self.count,
        }


def request_messages(
    link: mavlink.MavlinkLink, batches: Iterator[Batches], requests: Iterable[MessageRequest]
) -> tuple[RequestOutcome, ...]:
    """Send each request to who shall fulfil it, and wait for the answer; up to three times.

    An acknowledgement does not say which message it is about: the next request is sent only after it.

    Args:
        link: Open; its frames come with ``batches``.
        batches: One a tick, empty ones included.
        requests: To systems that are heard on the link; to nobody else anything is sent.
    """
    senders: _Senders = {}
    return tuple(RequestOutcome(request, _answer_to(link, batches, request, senders)) for request in requests)


def _answer_to(
    link: mavlink.MavlinkLink, batches: Iterator[Batches], request: MessageRequest, senders: _Senders
) -> str:
    attempts, due_ns, first_ns = 0, 0, None
    for batch in batches:
        now_ns = int(batch.now_ns[-1])
        first_ns = now_ns if first_ns is None else first_ns
        for block in batch.raw:
            heads = mavlink.headers(block)
            senders |= dict.fromkeys(map(tuple, np.unique(heads[1:3, heads[0] >= 0], axis=1).T.tolist()), block.sender)
            answer = _answer(block, heads, request) if attempts else None
            if answer is not None:
                return answer
        if now_ns < due_ns:
            continue
        if attempts == _ATTEMPTS or now_ns - first_ns > _ATTEMPTS * _PATIENCE_NS:
            break
        of_system = (sender for (system, _), sender in senders.items() if system == request.system)
        # Somebody else of its system may pass it on.
        sender = senders.get((request.system, request.component)) or next(of_system, None)
        if sender is not None:
            link.send(sender, request.command(attempts))
            attempts, due_ns = attempts + 1, now_ns + _PATIENCE_NS
    return _NO_ANSWER


def _answer(block: RawBlock, heads: IntArray, request: MessageRequest) -> str | None:
    """Answer to a request in a block's frames; None where there is none, or the request is in progress."""
    sender = (heads[1] == request.system) & (heads[2] == request.component)
    acknowledged = mavlink.payload_rows(block, heads[3:, (heads[0] == _COMMAND_ACK) & sender], _ACK)
    is_ours = np.isin(acknowledged["target_system"], (0, mavlink.OWN_SYSTEM)) & (
        acknowledged["command"] == request.command_id
    )
    results = acknowledged["result"][is_ours & (acknowledged["result"] != dialect.MAV_RESULT_IN_PROGRESS)].tolist()
    return _ANSWERS.get(results[0], f"refused (result {results[0]})") if results else None
