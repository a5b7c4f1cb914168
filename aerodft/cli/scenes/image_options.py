"""Camera, pose, ground, probes and their standard deviations, as options of the commands about one image."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeAlias

import typer

from aerodft.cli.output import say
from aerodft.conventions import LARGEST
from aerodft.errors import UsageError
from aerodft.model import Camera, FloatArray, KnownPoint, PoseSample, ProbeKind, ProjectionModel

if TYPE_CHECKING:
    from aerodft.app.measure import CameraPose, ElevationModel, ImageProbe, MeasuredSurface, PoseStd, Slope
    from aerodft.dft import Request, Setup

_of_pose: Final = partial(typer.Option, rich_help_panel="Camera and pose")
_of_ground: Final = partial(typer.Option, rich_help_panel="Ground")
of_uncertainty: Final = partial(typer.Option, rich_help_panel="Uncertainty and model")

_ANGLES: Final = ("tilt", "pan", "roll")
_POSE_STDS: Final = ("height", "position", *_ANGLES, "heading", "attitude")
_OTHER_STDS: Final = ("focal", "elevation", "px")  # of the camera, the surface, and the pixels
_PROBE_OPTIONS: Final = ("elevation", "elevation_std", "name")
_Elevations: TypeAlias = float | tuple[float, ...]
_LEVEL: Final = ("roll", "heading")  # of which 0 says nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseOptions:
    """Camera and pose of one image, and how well they are known."""

    camera: Annotated[Path | None, _of_pose(help="Camera file (TOML).")] = None
    height: Annotated[float | None, _of_pose(help="Camera height above the ground right below it, m.")] = None
    tilt: Annotated[float | None, _of_pose(help="Angle of the optical axis from straight down, deg.")] = None
    roll: Annotated[float | None, _of_pose(help="Positive with the camera's right side down, deg; else 0.")] = None
    heading: Annotated[float | None, _of_pose(help="Clockwise from true north, deg; else 0.")] = None
    lat: Annotated[float | None, _of_pose(help="Camera latitude, WGS84, deg.")] = None
    lon: Annotated[float | None, _of_pose(help="Camera longitude, WGS84, deg.")] = None
    calibration: Annotated[
        Path | None,
        _of_pose(
            help="Take pose and lens of a calibration file; or, where it has biases, correct --height, ... by them."
        ),
    ] = None
    std: Annotated[
        str | None,
        of_uncertainty(
            help="Standard deviations: height,position,elevation,focal(px),px; tilt,pan,roll,heading,attitude. What is"
            " not named is assumed, which is said; 0 says exact."
        ),
    ] = None
    covariance: Annotated[
        Path | None,
        of_uncertainty(help="6 x 6 covariance: position ENU (m), rotation in camera axes (rad); JSON rows."),
    ] = None

    @property
    def stds(self) -> "Stds":
        """Standard deviations that ``--std`` states.

        Raises:
            UsageError: It cannot be read.
        """
        return parse_stds(self.std)

    @property
    def surface(self) -> "MeasuredSurface":
        """The measured surface: the ground."""
        from aerodft.app.measure import MeasuredSurface

        return MeasuredSurface(0.0, self.stds.elevation_m, None)

    def stated_pose(self) -> dict[str, Any]:
        """Options of the pose that are given, see ``given_options``."""
        return given_options(self, "camera", "calibration", "std", "elevation", "max_range")

    def scene(
        self,
        ground: "GroundOptions | None" = None,
        model: ProjectionModel | None = None,
        photo: Path | None = None,
        home_above_plane_m: float | None = None,
    ) -> "tuple[Setup, PoseSample]":
        """Camera, ground and pose.

        Args:
            ground: What the ground is like; None for level ground.
            model: Projection model; None for the calibration's, else the pinhole.
            photo: Photograph that says what the options leave out; None where they have to say all.
            home_above_plane_m: Height of the photograph's take-off point above the water; None if not given.

        Raises:
            UsageError: There is no camera, or options do not go together.
            InputError: Something is impossible.
        """
        from aerodft.adapters.config.camera import load_calibration, load_camera
        from aerodft.app.measure import image_setup

        known = None if self.calibration is None else load_calibration(self.calibration)
        terms, altitude_m = (None, None) if ground is None else (ground.terms(), ground.altitude)
        camera, pose = self.camera, None
        if known is not None and known.pose is not None:
            refuse_beside(self.stated_pose() | ({} if ground is None else {"altitude": altitude_m}), "--calibration")
            self.stds.refuse_pose("--calibration", "px, elevation: the pose's are in the file")
            camera = camera if known.camera is None else None
        elif photo is not None and self._needs(photo):
            return self._photographed(photo, ground, model, home_above_plane_m)
        elif camera is None:
            raise UsageError("no --camera", expected="a camera file, e.g. configs/cameras/canon-1000d.toml")
        else:
            pose = self._pose(altitude_m)
        if home_above_plane_m is not None:
            raise UsageError("--home-above-plane", expected="it with a photograph that says its height above take-off")
        lens = None if camera is None else self.stds.on_camera(load_camera(camera))
        return image_setup(lens, pose, ground=terms, model=model, calibration=self.calibration, surface=self.surface)

    def _pose(self, altitude_m: float | None) -> "CameraPose":
        from aerodft.app.measure import CameraPose

        if self.tilt is None:
            raise UsageError("no --tilt", expected="0 to 180 deg from straight down: 0 nadir, 90 horizon")
        return CameraPose(
            height_m=self.height,
            altitude_m=altitude_m,
            tilt_deg=self.tilt,
            roll_deg=self.roll or 0.0,
            heading_deg=self.heading or 0.0,
            lat_deg=self.lat,
            lon_deg=self.lon,
            std=self.stds.pose_std(),
            covariance=self._covariance(),
        )

    def _covariance(self) -> "FloatArray | None":
        from aerodft.adapters.config import load_covariance

        if self.covariance is None:
            return None
        self.stds.refuse_pose("--covariance", "px, focal, elevation: the rest is there")
        return load_covariance(self.covariance)

    def _needs(self, photo: Path) -> bool:
        """Whether a photograph says what the options leave out: its own pose, or the camera."""
        from aerodft.app.measure import carries_pose

        return self.camera is None or carries_pose(photo)

    def _photographed(
        self,
        photo: Path,
        ground: "GroundOptions | None",
        model: ProjectionModel | None,
        home_above_plane_m: float | None,
    ) -> "tuple[Setup, PoseSample]":
        """Camera, ground and pose of a photograph, with what is given by hand in place of its own; said on stderr."""
        from aerodft.adapters.config.camera import load_camera
        from aerodft.app.measure import StatedPose, image_setup, read_photograph

        stated = StatedPose(
            height_m=self.height,
            altitude_m=None if ground is None else ground.altitude,
            home_above_plane_m=home_above_plane_m,
            tilt_deg=self.tilt,
            roll_deg=self.roll,
            heading_deg=self.heading,
            lat_deg=self.lat,
            lon_deg=self.lon,
            std=self.stds.pose_std(),
            covariance=self._covariance(),
        )
        terms = None if ground is None else ground.terms()
        taken = read_photograph(
            photo,
            camera=None if self.camera is None else load_camera(self.camera),
            stated=stated,
            is_over_terrain=ground is not None and ground.terrain is not None,
        )
        say(f"{photo.name}: {taken.summary}")
        lens = self.stds.on_camera(taken.camera)
        return image_setup(
            lens, taken.pose, ground=terms, model=model, calibration=self.calibration, surface=self.surface
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceOptions(PoseOptions):
    """Camera and pose of one image, and the level surface that is measured in it."""

    elevation: Annotated[float, _of_ground(help="Height of what is measured above the ground, m.")] = 0.0
    max_range: Annotated[float | None, _of_ground(help="Maximum range in metres.")] = None

    @property
    def surface(self) -> "MeasuredSurface":
        """The measured surface."""
        from aerodft.app.measure import MeasuredSurface

        return MeasuredSurface(self.elevation, self.stds.elevation_m, self.max_range)


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundOptions:
    """Ground that is not level."""

    altitude: Annotated[
        float | None, _of_pose(help="With --terrain, instead of --height: above mean sea level, m.")
    ] = None
    slope: Annotated[float | None, _of_ground(help="Ground that rises at this angle, through the foot, deg.")] = None
    uphill: Annotated[float | None, _of_ground(help="Where it rises, clockwise from true north, deg.")] = None
    terrain: Annotated[Path | None, _of_ground(help="Ground of an elevation model (GeoTIFF); needs --lat.")] = None

    def terms(self) -> "Slope | ElevationModel | None":
        """The ground's shape; None for level ground.

        Raises:
            UsageError: Options do not go together.
        """
        from aerodft.app.measure import ElevationModel, Slope

        if self.terrain is not None:
            refuse_beside({"slope": self.slope, "uphill": self.uphill}, "--terrain")
        if (self.slope is None) != (self.uphill is None):
            raise UsageError("--slope and --uphill go together", expected="e.g. --slope 11.3 --uphill 270")
        if self.slope is not None and self.uphill is not None:
            return Slope(slope_deg=self.slope, uphill_deg=self.uphill)
        return None if self.terrain is None else ElevationModel(self.terrain)


def given_options(options: PoseOptions | GroundOptions, *without: str) -> dict[str, Any]:
    """The options of a group that say something, by their names; not those ``without``."""
    named = {each.name: getattr(options, each.name) for each in fields(options) if each.name not in without}
    return {name: value for name, value in named.items() if value is not None and (value or name not in _LEVEL)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Stds:
    """Standard deviations that ``--std`` states.

    Attributes:
        pose: Of height (m), position (m) and angles (deg), by the names of ``--std``.
        focal_px: Of the focal length; None for what the camera file says.
        elevation_m: Of the measured surface.
        px: Of each pixel coordinate; None for the assumed 1 px.
    """

    pose: Mapping[str, float] = field(default_factory=dict)
    focal_px: float | None = None
    elevation_m: float = 0.0
    px: float | None = None

    def pose_std(self) -> "PoseStd":
        """Standard deviations of the pose."""
        from aerodft.app.measure import PoseStd

        units = {"height": "m", "position": "m"}
        return PoseStd(**{f"{name}_{units.get(name, 'deg')}": value for name, value in self.pose.items()})

    def refuse_pose(self, beside: str, expected: str) -> None:
        """Refuse standard deviations of the pose beside what has its own.

        Raises:
            UsageError: One that is not 0 was given.
        """
        if any(self.pose.values()):
            raise UsageError(f"--std of the pose beside {beside}", expected=expected)

    def on_camera(self, camera: Camera) -> Camera:
        """The camera, with the focal length's std where one was given.

        Raises:
            UsageError: The camera has a whole covariance.
        """
        if self.focal_px is None:
            return camera
        if camera.covariance:
            raise UsageError("--std focal beside a camera file with a covariance", expected="one of the two")
        return replace(camera, std=replace(camera.std, focal_px=self.focal_px))


def parse_stds(text: str | None) -> Stds:
    """Read ``name=value`` pairs: m for lengths, degrees for angles, px for pixels.

    Raises:
        UsageError: An unknown name, or a value that is no number of at least 0 (or absurdly large).
    """
    pose: dict[str, float] = {}
    others: dict[str, float] = {}
    names = set[str]()
    for part in filter(None, (piece.strip() for piece in (text or "").split(","))):
        name, _, number = part.partition("=")
        value = float(number) if _is_number(number) else math.nan
        if not 0 <= value <= LARGEST:
            expected = "a number of at least 0, e.g. height=0.1"
            raise UsageError(f"--std {part}", got=repr(number), expected=expected)
        if name in names:
            raise UsageError(f"--std {part}", got=f"{name} again", expected="each once")
        names.add(name)
        if name in _POSE_STDS:
            pose |= dict.fromkeys(_ANGLES if name == "attitude" else (name,), value)
        elif name in _OTHER_STDS:
            others[name if name == "px" else f"{name}_{'px' if name == 'focal' else 'm'}"] = value
        else:
            expected = f"one of {', '.join([*_POSE_STDS, *_OTHER_STDS])}"
            raise UsageError(f"--std {part}", got=f"name {name!r}", expected=expected)
    return Stds(pose=pose, **others)


def refuse_beside(options: Mapping[str, object], beside: str) -> None:
    """Refuse options beside what says the same: an option as typed, or an argument in words.

    Raises:
        UsageError: One of them was given.
    """
    for name, value in options.items():
        if value is not None:
            raise UsageError(f"--{name} beside {beside}", expected=f"one of them: {beside} has it")


def parse_probes(
    texts: list[str], stds: Stds, elevation_m: float, points: "Mapping[str, KnownPoint] | None" = None
) -> "tuple[Request, ...]":
    """Read all ``--probe`` of one command: ``distance 812,604.5 1377,611 elevation=0.5``.

    Args:
        texts: A kind, as many ``u,v`` as it needs, and ``key=value`` options each. In place of ``u,v`` may stand
            ``@NAME``, a surveyed point with its pixel and height, or ``u,v@NAME``, a pixel with that point's height.
            ``elevation`` is a number, one for each point without a name (``0.03,0.48``), or the name of a ``height`` on
            whose object's top the probe lies; ``elevation_std`` a number, or one for each point.
        stds: Of pixels and elevations.
        elevation_m: Of probes that have no ``elevation``.
        points: Surveyed points by name.

    Raises:
        UsageError: An unknown kind, option or name, a name twice, a malformed pixel, or too many or too few of them.
    """
    from aerodft.app.measure import requests_of

    probes = [_parse_probe(text, stds, elevation_m, points or {}) for text in texts]
    try:
        return requests_of(probes)
    except UsageError as error:
        raise UsageError(f"--probe: {error.what}", got=error.got, expected=error.expected) from None


def _parse_probe(text: str, stds: Stds, elevation_m: float, points: "Mapping[str, KnownPoint]") -> "ImageProbe":
    from aerodft.app.measure import probe
    from aerodft.dft import PROBE_KINDS, probe_end

    kind, *words = text.split() or [""]
    if ProbeKind(kind) not in PROBE_KINDS:
        expected = f"one of {', '.join(PROBE_KINDS)}"
        raise UsageError(f'--probe "{text}"', got=f"kind {kind!r}", expected=expected)
    options = _options(words, text)
    elevation, std = options.get("elevation", ""), options.get("elevation_std", "")
    named = elevation != "" and "," not in elevation and not _is_number(elevation)
    try:
        return probe(
            kind,
            [probe_end(word, points) for word in words if "=" not in word],
            name=options.get("name"),
            std_px=1.0 if stds.px is None else stds.px,
            elevation_m=elevation_m if named or not elevation else _numbers(elevation, text),
            elevation_std_m=_numbers(std, text) if std else stds.elevation_m,
            on_top_of=elevation if named else None,
        )
    except UsageError as error:
        raise UsageError(f'--probe "{text}"', got=error.got, expected=error.expected) from None


def _options(words: list[str], text: str) -> dict[str, str]:
    options: dict[str, str] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals:
            continue
        if key not in _PROBE_OPTIONS:
            expected = f"one of {', '.join(_PROBE_OPTIONS)}"
            raise UsageError(f'--probe "{text}"', got=f"option {key!r}", expected=expected)
        if not value:
            raise UsageError(f'--probe "{text}"', got="nothing", expected=f"a value after {key}=")
        if key in options:
            raise UsageError(f'--probe "{text}"', got=f"{key} again", expected="each option once")
        options[key] = value
    return options


def _numbers(words: str, text: str) -> _Elevations:
    """A number, or several between commas."""
    parts = words.split(",")
    if len(parts) > 1 and not all(map(_is_number, parts)):
        expected = "a number, one for each point as 0.03,0.48, or the name of one height"
        raise UsageError(f'--probe "{text}"', got=repr(words), expected=expected)
    numbers = tuple(_finite(part, text) for part in parts)
    return numbers if len(numbers) > 1 else numbers[0]


def _is_number(word: str) -> bool:
    """Whether a word is a number; so is ``nan``, which is no name either."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _finite(number: str, text: str) -> float:
    value = float(number) if _is_number(number) and number.isascii() and "_" not in number else math.nan
    if not abs(value) <= LARGEST:
        raise UsageError(f'--probe "{text}"', got=repr(number), expected="a finite number")
    return value
