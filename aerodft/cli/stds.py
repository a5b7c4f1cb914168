"""``--std height=0.1,tilt=0.2,px=1``: standard deviations as people write them."""

import math
from dataclasses import dataclass, field, replace

from aerodft.conventions import LARGEST
from aerodft.errors import UsageError
from aerodft.model.camera import Camera
from aerodft.model.pose import PoseStd

_KEYS = {
    "height": ("height_agl_m",),
    "position": ("horizontal_m",),
    "tilt": ("tilt_rad",),
    "pan": ("pan_rad",),
    "roll": ("roll_rad",),
    "heading": ("heading_rad",),
    "attitude": ("tilt_rad", "pan_rad", "roll_rad"),
}
_OTHERS = ("focal", "elevation", "px")  # of the camera, the plane, and the pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class Stds:
    """What ``--std`` says; what it does not name is taken as exact.

    Attributes:
        pose: Height, position and angles.
        focal_px: Of the focal length.
        elevation_m: Of the measured plane.
        px: Of each pixel coordinate.
        assumptions: What was assumed because nothing was said; goes into every measurement's reasons.
    """

    pose: PoseStd = field(default_factory=PoseStd)
    focal_px: float = 0.0
    elevation_m: float = 0.0
    px: float = 1.0
    assumptions: tuple[str, ...] = ()

    def with_other(self, name: str, value: float) -> "Stds":
        """Set ``focal`` (px), ``elevation`` (m) or ``px``."""
        if name == "focal":
            return replace(self, focal_px=value)
        return replace(self, elevation_m=value) if name == "elevation" else replace(self, px=value)

    def on_camera(self, camera: Camera) -> Camera:
        """The camera, with the focal length's std where one was given.

        Raises:
            UsageError: The camera has a whole covariance.
        """
        if self.focal_px and camera.covariance:
            raise UsageError("--std focal beside a camera file with a covariance", expected="one of the two")
        return replace(camera, std=replace(camera.std, focal_px=self.focal_px)) if self.focal_px else camera


def assumed_stds(height_m: float) -> Stds:
    """What is assumed where ``--std`` is not given: exactness would be a lie."""
    angle = math.radians(0.3)
    pose = PoseStd(height_agl_m=0.01 * height_m, tilt_rad=angle, pan_rad=angle, roll_rad=angle)
    return Stds(pose=pose, assumptions=("no --std: assumed height 1 %, attitude 0.3 deg, px 1",))


def parse_stds(text: str) -> Stds:
    """Read ``name=value`` pairs: m for lengths, degrees for angles, px for pixels.

    Raises:
        UsageError: An unknown name, or a value that is no number of at least 0 (or absurdly large).
    """
    stds, names = Stds(), set[str]()
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        name, _, number = part.partition("=")
        value = _number(part, number)
        if name in names:
            raise UsageError(f"--std {part}", got=f"{name} again", expected="each once")
        names.add(name)
        if name in _KEYS:
            scaled = {key: math.radians(value) if key.endswith("_rad") else value for key in _KEYS[name]}
            stds = replace(stds, pose=replace(stds.pose, **scaled))
        elif name in _OTHERS:
            stds = stds.with_other(name, value)
        else:
            raise UsageError(f"--std {part}", got=f"name {name!r}", expected=f"one of {', '.join([*_KEYS, *_OTHERS])}")
    return stds


def _number(part: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value <= LARGEST:
        raise UsageError(f"--std {part}", got=repr(text), expected="a number of at least 0, e.g. height=0.1")
    return value
