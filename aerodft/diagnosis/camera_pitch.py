"""Where a camera looks over a flight, and what may be wrong with its angles where it does not see the ground."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.adapters.telemetry.mavlink import GIMBAL_MESSAGES
from aerodft.geometry import matrix
from aerodft.model import BoolArray, FloatArray, GimbalSource, PoseBatch

_MAX_SEEN_SHARE: Final = 0.5  # of the images; a camera that sees the ground in more of them is no fault
_MIN_UP_DEG: Final = 5.0  # lowest pitch of a flight that suggests a sign: more than the error of a level gimbal
_MAX_TINY_DEG: Final = 1.8  # as large as 180 deg are in a field of centidegrees
_MAX_RADIAN_DEG: Final = math.pi / 2 + 0.01  # as large as 90 deg are in radians
_MIN_TINY_DEG: Final = 0.05  # 5 deg in a field of centidegrees, 3 deg in radians; nearer 0 nothing is known
_MAX_PITCH_DEG: Final = 180.0
_LOWEST_DEG, _HIGHEST_DEG = -135.0, 90.0  # pitches that gimbals reach
_QUATERNIONS: Final = frozenset(each.name for each in GIMBAL_MESSAGES if each.pitch is None)
_CENTIDEGREES: Final = frozenset(each.name for each in GIMBAL_MESSAGES if each.pitch and each.pitch[1] == 0.01)  # noqa: PLR2004
_SMALLER_UNITS: Final = {"tenths of a degree": 0.1, "hundredths of a degree": 0.01, "thousandths of a degree": 0.001}


@dataclass(slots=True)
class PitchRange:
    """Pitches of a camera over a flight, by one source of its attitude.

    Attributes:
        low_deg: Lowest pitch; 0 is the horizon, -90 straight down.
        high_deg: Highest pitch.
        count: Number of images.
        seen: In how many of them the measured pixels, or the image's middle, see the ground.
    """

    low_deg: float = math.inf
    high_deg: float = -math.inf
    count: int = 0
    seen: int = 0

    def add(self, pitch_deg: FloatArray, sees_ground: BoolArray) -> None:
        """Take in images ``(n,)``, at least one."""
        self.low_deg = min(self.low_deg, float(pitch_deg.min()))
        self.high_deg = max(self.high_deg, float(pitch_deg.max()))
        self.count += len(pitch_deg)
        self.seen += int(np.count_nonzero(sees_ground))

    @property
    def text(self) -> str:
        """The range in words."""
        return pitch_text(self.low_deg, self.high_deg)


class CameraPitches:
    """Takes in poses, and says whether their source has an angle with a wrong sign or in a wrong unit."""

    def __init__(self) -> None:
        self._ranges: dict[str, PitchRange] = {}

    def add(self, poses: PoseBatch, sees_ground: BoolArray) -> None:
        """Take in poses ``(n,)``; those without an attitude are left out.

        Args:
            poses: Of the camera.
            sees_ground: ``(n,)`` whether what is measured, or the image's middle, has an answer.
        """
        ok = np.flatnonzero(poses.has_pose & poses.is_ok)
        if not len(ok):
            return
        pitch_deg = np.degrees(np.arcsin(np.clip(matrix(poses.pose.wxyz[ok])[:, 2, 2], -1.0, 1.0)))  # of the z axis
        sources = [str(variant.attitude_source) for variant in poses.variants]
        index = poses.variant_index[ok]
        for name in dict.fromkeys(sources):
            own = np.isin(index, [number for number, each in enumerate(sources) if each == name])
            if own.any():
                self._ranges.setdefault(name, PitchRange()).add(pitch_deg[own], sees_ground[ok][own])

    def sentences(self) -> list[str]:
        """One sentence for each source by which the camera does not see the ground, where its angles explain that."""
        found = ((name, each) for name, each in self._ranges.items() if each.seen <= _MAX_SEEN_SHARE * each.count)
        return [sentence for name, each in found if (sentence := _suspicion(name, each))]


def pitch_text(low_deg: float, high_deg: float) -> str:
    """A range of pitches in words."""
    text = f"{low_deg:+.2f} deg"
    return text if round(low_deg, 2) == round(high_deg, 2) else f"{low_deg:+.2f} to {high_deg:+.2f} deg"


def _suspicion(name: str, found: PitchRange) -> str:
    """The likely fault of a source's angles, with the key that corrects it; empty where none explains the pitches."""
    start = f"the camera {'never' if found.seen == 0 else 'seldom'} sees the ground where it is measured: "
    where = f"{name} says a pitch of {found.text} (0 is the horizon, -90 straight down)"
    largest_deg = max(abs(found.low_deg), abs(found.high_deg))
    is_tiny = _MIN_TINY_DEG <= largest_deg <= _MAX_TINY_DEG
    if name == GimbalSource.FIXED_MOUNT:
        looks_up = found.low_deg > _MIN_UP_DEG
        advice = "sign inverted? Then invert telemetry.attitude.fixed_mount.pitch_deg"
        return f"{start}{where}: {advice}" if looks_up else ""
    if is_tiny and name not in _QUATERNIONS:
        return f"{start}{where}: {_tiny_unit(name, found)}" if _tiny_unit(name, found) else ""
    if found.low_deg > _MIN_UP_DEG:
        return f"{start}{where}: sign inverted? Then set {scale_key(name, pitch=-1)}"
    return ""


def _tiny_unit(name: str, found: PitchRange) -> str:
    """Which unit angles near 0 may have, and the key; empty where none fits."""
    sign = -1 if found.low_deg + found.high_deg > 0 else 1
    factors = {"degrees in a field of centidegrees": 100.0} if name in _CENTIDEGREES else {}
    if name not in _CENTIDEGREES and max(-found.low_deg, found.high_deg) <= _MAX_RADIAN_DEG:
        factors = {"radians in a field of degrees": 180 / math.pi}
    for unit, factor in factors.items():
        ends = sorted(sign * factor * end for end in (found.low_deg, found.high_deg))
        turned = ", with the sign inverted" if sign < 0 else ""
        key = scale_key(name, yaw=factor, pitch=sign * factor, roll=factor)
        return f"{unit}{turned} ({pitch_text(*ends)})? Then set {key}"
    return ""


def too_large_sentence(name: str, low_deg: float, high_deg: float) -> str:
    """Sentence on pitches that are no angles in their field's unit; empty where no smaller unit makes them some."""
    if max(abs(low_deg), abs(high_deg)) <= _MAX_PITCH_DEG:
        return ""
    for unit, factor in _SMALLER_UNITS.items():
        if low_deg * factor >= _LOWEST_DEG and high_deg * factor <= _HIGHEST_DEG:
            scaled = pitch_text(low_deg * factor, high_deg * factor)
            return (
                f"{name} says a pitch of {pitch_text(low_deg, high_deg)}: {unit} ({scaled})? "
                f"Then set {scale_key(name, yaw=factor, pitch=factor, roll=factor)}"
            )
    return ""


def scale_key(name: str, **factors: float) -> str:
    """The configuration key that corrects a source's angles."""
    return f"telemetry.attitude.scale.{name} = {{ {', '.join(f'{axis} = {k:.7g}' for axis, k in factors.items())} }}"
