"""What cameras should say of their view, and whom to ask for it."""

from collections.abc import Iterator, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.mavlink import selection as pick
from aerodft.adapters.mavlink.camera_rows import MOST_ATTACHED
from aerodft.adapters.mavlink.requests import ARDUPILOT, MessageRequest
from aerodft.adapters.mavlink.streams import Stream
from aerodft.model.zoom import ZoomSource
from aerodft.service.zoom_settings import ZoomSettings

_RATE_HZ: Final = 1.0
_COMPONENTS: Final = range(dialect.MAV_COMP_ID_CAMERA, dialect.MAV_COMP_ID_CAMERA6 + 1)
_IDS: Final = {
    ZoomSource.CAMERA_SETTINGS: pick.CAMERA_SETTINGS,
    ZoomSource.CAMERA_FOV_STATUS: pick.CAMERA_FOV_STATUS,
    ZoomSource.VIDEO_STREAM_INFORMATION: pick.VIDEO_STREAM_INFORMATION,
}
_NAMES: Final = frozenset(map(str, _IDS))
_OF_ARDUPILOT: Final = (ZoomSource.CAMERA_SETTINGS, ZoomSource.CAMERA_FOV_STATUS)


def wanted_of_cameras(
    streams: Sequence[Stream], *, system: int | None, component: int | None, autopilot: int | None, zoom: ZoomSettings
) -> Iterator[MessageRequest]:
    """What cameras should say of their view: of each source before the first that they say anything in.

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
        for source in zoom.order:
            if (str(source), camera) in heard:
                break
            if not is_autopilot or source in _OF_ARDUPILOT:
                yield MessageRequest(
                    message_id=_IDS[source],
                    rate_hz=_RATE_HZ if is_autopilot else None,
                    now_hz=0.0,
                    system=system,
                    component=camera,
                    autopilot=autopilot if is_autopilot else None,
                )


def _cameras(heard: set[tuple[str, int]], component: int, autopilot: int | None, zoom: ZoomSettings) -> set[int]:
    """Components to ask: those that are cameras or speak for some, or the one that a station needs."""
    speakers = {who for name, who in heard if name in _NAMES or who in _COMPONENTS}
    if zoom.camera is not None:
        cameras = {zoom.camera if zoom.camera > MOST_ATTACHED else component}
    elif speakers or not (zoom.curve or zoom.reported_hfov_rad):
        cameras = speakers
    else:
        cameras = {component if autopilot == ARDUPILOT else _COMPONENTS.start}
    return cameras if autopilot == ARDUPILOT else cameras - {component}
