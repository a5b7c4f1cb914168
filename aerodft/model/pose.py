"""Where the camera is and where it looks, with one joint covariance."""

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from typing import ClassVar, Final, TypeVar, overload

import numpy as np

from aerodft.model.arrays import BoolArray, FloatArray, FloatLike, IntArray, read_only
from aerodft.model.camera import Zoom
from aerodft.model.status import CODE_OF, Status

_TRAILING = {"position_enu_m": (3,), "wxyz": (4,), "cov": (6, 6), "velocity_enu_mps": (3,), "rate_cam_radps": (3,)}


def _zeros(*shape: int) -> FloatArray:
    return read_only(np.zeros(shape))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pose:
    """``enu_SE3_cam``: the camera in the station's ENU frame; batch-first.

    Attributes:
        position_enu_m: ``(..., 3)``; up is the height above the measured (ground or water) plane.
        wxyz: ``(..., 4)`` unit quaternion ``enu_SO3_cam``; camera axes x right, y down, z forward.
        cov: ``(..., 6, 6)``: position (ENU, m^2), then a small rotation in camera axes (rad^2). Never Euler angles.
        lens_cov: ``(..., 6, m)`` covariance of those errors with the intrinsics', where one calibration found both;
            else no columns.
        velocity_enu_mps: ``(..., 3)``, for the effect of a time offset.
        rate_cam_radps: ``(..., 3)`` angular rate in camera axes, for the effect of a time offset.
        time_std_s: ``(...)`` standard deviation of the image's stamp against the telemetry's.
    """

    position_enu_m: FloatArray
    wxyz: FloatArray
    cov: FloatArray = field(default_factory=lambda: _zeros(6, 6))
    lens_cov: FloatArray = field(default_factory=lambda: _zeros(6, 0))
    velocity_enu_mps: FloatArray = field(default_factory=lambda: _zeros(3))
    rate_cam_radps: FloatArray = field(default_factory=lambda: _zeros(3))
    time_std_s: FloatLike = 0.0

    def __post_init__(self) -> None:
        for name, trailing in _TRAILING.items():
            object.__setattr__(self, name, read_only(getattr(self, name), trailing=trailing))

    def rows(self, rows: IntArray | int) -> "Pose":
        """Some of ``(n,)`` poses by their indices ``(m,)``, or a single one; what is one for all of them stays so."""
        axes = {"lens_cov": 2, **{name: len(trailing) for name, trailing in _TRAILING.items()}}
        columns = {name: getattr(self, name) for name in axes}
        taken = {name: each[rows] if each.ndim > axes[name] else each for name, each in columns.items()}
        return Pose(**taken, time_std_s=np.broadcast_to(self.time_std_s, len(self.wxyz))[rows])

    @staticmethod
    def joined(poses: Sequence["Pose"]) -> "Pose":
        """Single poses, or ``(n,)``, ``(m,)``, ..., as one ``(n + m + ...,)``.

        Where only some were found together with a lens, the others' covariances with it are 0.
        """
        columns = max((pose.lens_cov.shape[-1] for pose in poses), default=0)
        shapes = {**_TRAILING, "lens_cov": (6, columns), "time_std_s": ()}
        ends = np.cumsum([0, *(pose.wxyz.size // 4 for pose in poses)]).tolist()
        together = {name: np.zeros((ends[-1], *shape)) for name, shape in shapes.items()}
        for pose, start, stop in zip(poses, ends, ends[1:], strict=False):
            for name, values in together.items():
                if name != "lens_cov" or pose.lens_cov.size:
                    values[start:stop] = getattr(pose, name)
        return Pose(**together)


class HeightSource(str):
    """Name of where a height above the measured plane came from.

    No enumeration: who adds a source to ``service.HEIGHT_SOURCES`` gives it a name there.
    """

    __slots__ = ()
    RANGEFINDER: ClassVar["HeightSource"]
    TERRAIN: ClassVar["HeightSource"]
    HOME: ClassVar["HeightSource"]
    MANUAL: ClassVar["HeightSource"]
    CALIBRATION: ClassVar["HeightSource"]


HeightSource.RANGEFINDER = HeightSource("rangefinder")
HeightSource.TERRAIN = HeightSource("terrain")
HeightSource.HOME = HeightSource("home")
HeightSource.MANUAL = HeightSource("manual")
HeightSource.CALIBRATION = HeightSource("calibration")


class GimbalSource(StrEnum):
    """Where the camera's attitude came from."""

    GIMBAL_DEVICE = "GIMBAL_DEVICE_ATTITUDE_STATUS"
    MOUNT_ORIENTATION = "MOUNT_ORIENTATION"
    MOUNT_STATUS = "MOUNT_STATUS"
    DATAFLASH_MNT = "MNT"
    FIXED_MOUNT = "fixed"
    MANUAL = "manual"


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseStd:
    """Standard deviations as people say them: small rotations about the camera's x, y, z axes and the vertical."""

    height_agl_m: float = 0.0
    horizontal_m: float = 0.0
    tilt_rad: float = 0.0
    pan_rad: float = 0.0
    roll_rad: float = 0.0
    heading_rad: float = 0.0
    time_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class GeoOrigin:
    """The station's fixed ENU origin: a point of the measured plane (WGS84)."""

    lat_rad: float
    lon_rad: float
    alt_msl_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseSample:
    """The camera at one stamp, with where each part came from; ``pose`` is None where ``status`` is not ok.

    ``datum_enu_m`` is the ENU height of what the stated height is counted from: not 0 above ground that is not level.
    ``zoom`` is what the vehicle says of the camera's view, where that is followed; None where its file holds.
    """

    stamp_ns: int
    status: Status
    reasons: tuple[str, ...] = ()
    pose: Pose | None = None
    std: PoseStd = field(default_factory=PoseStd)
    origin: GeoOrigin | None = None
    lat_rad: float | None = None
    lon_rad: float | None = None
    alt_msl_m: float | None = None
    height_source: HeightSource | None = None
    height_datum: str | None = None
    datum_enu_m: float = 0.0
    height_age_s: float | None = None
    attitude_source: GimbalSource | None = None
    telemetry_age_s: float | None = None
    calibration: str | None = None
    zoom: Zoom | None = None

    @property
    def lat_lon_alt(self) -> tuple[float | None, float | None, float | None]:
        """Latitude, longitude (rad) and altitude (m MSL), None where they are not known."""
        return self.lat_rad, self.lon_rad, self.alt_msl_m

    @property
    def cov(self) -> FloatArray | None:
        """Of the pose."""
        return None if self.pose is None else self.pose.cov


_Key = TypeVar("_Key", bound=Hashable)

_STDS: Final = tuple(each.name for each in fields(PoseStd))
HORIZONTAL: Final = _STDS.index("horizontal_m")
"""Column of ``PoseBatch.std`` that holds the position's standard deviation."""
TIME: Final = _STDS.index("time_s")
"""Column of ``PoseBatch.std`` that holds the stamp's standard deviation."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseBatch(Sequence[PoseSample]):
    """Poses at ``n`` stamps. What is not a number, and the same for many of them, stands once in ``variants``.

    Attributes:
        stamp_ns: ``(n,)`` UTC.
        pose: The ``(n,)`` poses with a covariance each; NaN where a sample has none.
        std: ``(n, 7)`` standard deviations in the order of the fields of ``PoseStd``.
        lat_lon_alt: ``(n, 3)`` latitude, longitude (rad), altitude (m MSL); NaN where unknown.
        height_age_s: ``(n,)`` time to the nearest sample of the height; NaN where unknown.
        telemetry_age_s: ``(n,)`` time to the nearest sample of the older part; NaN where unknown.
        datum_enu_m: ``(n,)`` ENU height of what the stated height is counted from.
        zoom: ``(n, 2)`` magnification against the camera's file, and its standard deviation; NaN where the file holds.
        variant_index: ``(n,)`` which of ``variants`` each sample is like.
        variants: Samples without the numbers above: status, reasons, origin, sources, calibration. A variant's zoom
            says its source alone.
    """

    stamp_ns: IntArray
    pose: Pose
    std: FloatArray
    lat_lon_alt: FloatArray
    height_age_s: FloatArray
    telemetry_age_s: FloatArray
    datum_enu_m: FloatArray
    zoom: FloatArray
    variant_index: IntArray
    variants: tuple[PoseSample, ...]

    @staticmethod
    def of(samples: Sequence[PoseSample]) -> "PoseBatch":
        """Samples as a batch, in their order."""
        variants, variant_index = _distinct([_variant(sample) for sample in samples])
        zooms = [(np.nan, np.nan) if s.zoom is None else (s.zoom.magnification, s.zoom.std) for s in samples]
        return PoseBatch(
            stamp_ns=np.array([sample.stamp_ns for sample in samples], dtype=np.int64),
            pose=_stacked([sample.pose for sample in samples]),
            std=np.array([[getattr(sample.std, name) for name in _STDS] for sample in samples]).reshape(-1, len(_STDS)),
            lat_lon_alt=_numbers([sample.lat_lon_alt for sample in samples]).reshape(-1, 3),
            height_age_s=_numbers([sample.height_age_s for sample in samples]),
            telemetry_age_s=_numbers([sample.telemetry_age_s for sample in samples]),
            datum_enu_m=np.array([sample.datum_enu_m for sample in samples], dtype=np.float64),
            zoom=np.array(zooms).reshape(-1, 2),
            variant_index=variant_index,
            variants=variants,
        )

    @staticmethod
    def joined(batches: Sequence["PoseBatch"]) -> "PoseBatch":
        """Several batches as one, one after the other."""
        if len(batches) == 1:
            return batches[0]
        variants, index = _distinct([variant for batch in batches for variant in batch.variants])
        firsts = np.cumsum([0, *(len(batch.variants) for batch in batches)]).tolist()
        own = [index[first + batch.variant_index] for batch, first in zip(batches, firsts[:-1], strict=True)]
        columns = {name: np.concatenate([getattr(batch, name) for batch in batches]) for name in _COLUMNS}
        pose = Pose.joined([batch.pose for batch in batches])
        return PoseBatch(pose=pose, variant_index=np.concatenate(own), variants=variants, **columns)

    @staticmethod
    def repeated(sample: PoseSample, stamps_ns: IntArray) -> "PoseBatch":
        """One sample at every stamp ``(n,)``: the pose of a camera that does not move."""
        alone = PoseBatch.of([sample])
        return replace(alone.rows(np.zeros(len(stamps_ns), dtype=np.int64)), stamp_ns=stamps_ns)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @overload
    def __getitem__(self, index: int) -> PoseSample: ...

    @overload
    def __getitem__(self, index: slice) -> "PoseBatch": ...

    def __getitem__(self, index: int | slice) -> "PoseSample | PoseBatch":
        if isinstance(index, slice):
            return self.rows(np.arange(len(self))[index])
        return self._sample(range(len(self))[index])

    def __iter__(self) -> Iterator[PoseSample]:
        return map(self._sample, range(len(self)))

    @property
    def status(self) -> IntArray:
        """``(n,)`` indices into ``CODES``."""
        return self.by_variant(lambda variant: CODE_OF[variant.status])

    @property
    def kind_index(self) -> IntArray:
        """``(n,)`` numbers; samples with the same one differ in numbers, reasons and calibration only."""
        found: dict[Hashable, int] = {}
        bare = [replace(variant, reasons=(), calibration=None) for variant in self.variants]
        return np.array([found.setdefault(_key(each), len(found)) for each in bare], dtype=np.int64)[self.variant_index]

    @property
    def variant_of_each(self) -> list[PoseSample]:
        """The variant that each sample is like."""
        return [self.variants[index] for index in self.variant_index.tolist()]

    @property
    def has_pose(self) -> BoolArray:
        """``(n,)`` whether there is a pose, whatever the status."""
        return ~np.isnan(self.pose.wxyz[:, 0])

    @property
    def is_ok(self) -> BoolArray:
        """``(n,)`` whether there is a pose that can be measured with."""
        return np.asarray((self.status == CODE_OF[Status.OK]) & self.has_pose)

    def rows(self, rows: IntArray) -> "PoseBatch":
        """Samples ``(m,)`` by their indices."""
        columns = {name: getattr(self, name)[rows] for name in _COLUMNS}
        return PoseBatch(
            pose=self.pose.rows(rows), variant_index=self.variant_index[rows], variants=self.variants, **columns
        )

    def where(self, chosen: BoolArray, change: Callable[["PoseBatch", IntArray], "PoseBatch"]) -> "PoseBatch":
        """The batch with those of its samples changed that are ``chosen (n,)``, and all others as they are.

        Args:
            chosen: Which are changed.
            change: Takes at least one sample, with its row here, and gives as many back.
        """
        rows = np.flatnonzero(chosen)
        if len(rows) == len(self):
            return change(self, rows)
        if not len(rows):
            return self
        order = np.arange(len(self))
        order[rows] = len(self) + np.arange(len(rows))
        return PoseBatch.joined([self, change(self.rows(rows), rows)]).rows(order)

    def by_variant(self, value: Callable[[PoseSample], int]) -> IntArray:
        """``(n,)`` a whole number of every sample's variant; variants that no sample is like are left out."""
        used, own = np.unique(self.variant_index, return_inverse=True)
        return np.array([value(self.variants[index]) for index in used.tolist()], dtype=np.int64)[own]

    def map_variants(self, change: Callable[[PoseSample], PoseSample]) -> "PoseBatch":
        """The batch with a new variant for each of the present ones."""
        return replace(self, variants=tuple(map(change, self.variants)))

    def with_variants(
        self, keys: Sequence[_Key | None], change: Callable[[PoseSample, _Key], PoseSample]
    ) -> "PoseBatch":
        """The batch with other variants.

        Args:
            keys: ``n`` of what a sample's new variant depends on, besides the present one; None where that stays.
            change: Makes the new variant from the present one and a key.
        """
        pairs = list(zip(self.variant_index.tolist(), keys, strict=True))
        numbers = {pair: number for number, pair in enumerate(dict.fromkeys(pairs))}
        variants = [self.variants[k] if key is None else change(self.variants[k], key) for k, key in numbers]
        variant_index = np.array([numbers[pair] for pair in pairs], dtype=np.int64)
        return replace(self, variants=tuple(variants), variant_index=variant_index)

    def without_poses(self) -> "PoseBatch":
        """The batch with nothing known of where its cameras are."""
        return replace(self, pose=_stacked([None]).rows(np.zeros(len(self), dtype=np.int64)))

    def _sample(self, row: int) -> PoseSample:
        variant = self.variants[int(self.variant_index[row])]
        lat, lon, alt = (_known(value) for value in self.lat_lon_alt[row].tolist())
        magnification, std = self.zoom[row].tolist()
        zoom = None if variant.zoom is None else Zoom(magnification=magnification, std=std, source=variant.zoom.source)
        return replace(
            variant,
            stamp_ns=int(self.stamp_ns[row]),
            pose=None if np.isnan(self.pose.wxyz[row, 0]) else self.pose.rows(row),
            std=PoseStd(**dict(zip(_STDS, self.std[row].tolist(), strict=True))),
            lat_rad=lat,
            lon_rad=lon,
            alt_msl_m=alt,
            height_age_s=_known(float(self.height_age_s[row])),
            telemetry_age_s=_known(float(self.telemetry_age_s[row])),
            datum_enu_m=float(self.datum_enu_m[row]),
            zoom=zoom,
        )


_COLUMNS: Final = ("stamp_ns", "std", "lat_lon_alt", "height_age_s", "telemetry_age_s", "datum_enu_m", "zoom")
_KEY_FIELDS: Final = (
    "status",
    "reasons",
    "origin",
    "height_source",
    "height_datum",
    "attitude_source",
    "calibration",
)


def _variant(sample: PoseSample) -> PoseSample:
    """A sample without its numbers."""
    zoom = None if sample.zoom is None else Zoom(magnification=np.nan, std=np.nan, source=sample.zoom.source)
    return PoseSample(stamp_ns=0, **{name: getattr(sample, name) for name in _KEY_FIELDS}, zoom=zoom)


def _distinct(variants: Sequence[PoseSample]) -> tuple[tuple[PoseSample, ...], IntArray]:
    """Variants that differ, and which of them each one ``(n,)`` is."""
    keys = [_key(variant) for variant in variants]
    numbers = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    found = dict(zip(keys, variants, strict=True))
    return tuple(found[key] for key in numbers), np.array([numbers[key] for key in keys], dtype=np.int64)


def _key(variant: PoseSample) -> Hashable:
    fields_of = (getattr(variant, name) for name in _KEY_FIELDS)
    return (*fields_of, None if variant.zoom is None else variant.zoom.source)


_NO_POSE: Final = Pose(position_enu_m=np.full(3, np.nan), wxyz=np.full(4, np.nan), cov=np.full((6, 6), np.nan))


def _stacked(poses: Sequence[Pose | None]) -> Pose:
    return Pose.joined([_NO_POSE if pose is None else pose for pose in poses])


def _numbers(values: Sequence[object]) -> FloatArray:
    """Numbers with NaN for None."""
    return np.array(values, dtype=np.float64)


def _known(value: float) -> float | None:
    return None if np.isnan(value) else value


_BEYOND_STDS: Final = 1.96
"""Two sources disagree where their difference lies outside of its 95 % interval."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightDifference:
    """Two sources at one moment.

    Attributes:
        stamp_ns: UTC.
        source: The one.
        other: The other one.
        height_m: What the one says, above the measured plane.
        other_m: What the other one says.
        std_m: Standard deviation of the difference, by what is stated of the two.
    """

    stamp_ns: int
    source: HeightSource
    other: HeightSource
    height_m: float
    other_m: float
    std_m: float

    @property
    def step_m(self) -> float:
        """The other one minus the one."""
        return self.other_m - self.height_m

    @property
    def is_beyond(self) -> bool:
        """Whether that is more than what is stated of the two explains."""
        return bool(self.is_step_beyond(np.array(self.step_m), np.array(self.std_m)))

    @staticmethod
    def is_step_beyond(step_m: FloatArray, std_m: FloatArray) -> BoolArray:
        """Whether steps ``(n,)`` are more than what is stated of the two, standard deviations ``(n,)``, explains."""
        return np.asarray(np.abs(step_m) > _BEYOND_STDS * std_m)

    def reversed(self) -> "HeightDifference":
        """The difference with its two sources exchanged."""
        return HeightDifference(
            stamp_ns=self.stamp_ns,
            source=self.other,
            other=self.source,
            height_m=self.other_m,
            other_m=self.height_m,
            std_m=self.std_m,
        )

    def sentence(self) -> str:
        """What the two say."""
        return (
            f"{self.other} says {self.other_m:.2f} m where {self.source} says {self.height_m:.2f} m: "
            f"{abs(self.step_m):.2f} m apart, their std is {self.std_m:.2f} m"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightSwitch:
    """From this stamp (UTC) on heights are of another source.

    ``step`` compares the two (``source`` before, ``other`` after) when both last spoke; None where they never did.
    """

    stamp_ns: int
    before: HeightSource
    after: HeightSource
    step: HeightDifference | None
