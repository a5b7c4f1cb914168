"""The camera that another tool recorded, held against the one that measures."""

from aerodft.cli.output import say
from aerodft.errors import InputError
from aerodft.model.camera import Camera
from replay.foreign import ForeignRecording

_STDS = 3.0
_SHARE = 0.01  # what two calibrations of one camera differ by, or a zoom by the least


def check_camera(recording: ForeignRecording, camera: Camera) -> None:
    """Say where the recording's own camera is another one; the camera that was asked for counts.

    Args:
        recording: With or without a camera.
        camera: What is measured with.
    """
    try:
        recorded = recording.camera()
    except InputError as error:
        say(f"aerodft: {error}; not compared with {camera.name!r}")
        return
    if recorded is None:
        return
    scale = camera.width_px / recorded.width_px
    apart_px = abs(recorded.fx_px * scale - camera.fx_px)
    if apart_px > max(_STDS * camera.std.focal_px, _SHARE * camera.fx_px):
        say(
            f"aerodft: {recording.path}: its camera ({recorded.name}) has a focal length of"
            f" {recorded.fx_px * scale:.1f} px, {camera.name!r} of {camera.fx_px:.1f} px, which is measured with"
        )
