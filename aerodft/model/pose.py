"""Camera poses with joint covariance, singly and in batches; sources of height and attitude."""

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import ClassVar, Final, Self, TypeVar, overload

import numpy as np

from aerodft.model.arrays import Batch, BoolArray, FloatArray, FloatLike, IntArray, Selection, read_only
from aerodft.model.camera import Zoom
from aerodft.model.status import CODE_OF, Status
from aerodft.model.water_level import WaterLevel

_TRAILING = {"position_enu_m": (3,), "wxyz": (4,), "cov": (6, 6), "velocity_enu_mps": (3,), "rate_cam_radps": (3,)}


def _zeros(*shape: int) -> FloatArray:
    return read_only(np.zeros(shape))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pose(Batch):
    """``enu_SE3_cam``: the camera in the station's ENU frame; batch-first.

    Attributes:
        position_enu_m: ``(..., 3)``; up is the height above the measured (ground or water) plane; after
            ``service.pose.over_water`` that of the water at the stamp.
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

    def rows(self, rows: Selection | int) -> "Pose":
        """Poses ``(m,)`` of ``(n,)`` of a selection, or a single one; fields without a batch axis are kept."""
        axes = {"lens_cov": 2, **{name: len(trailing) for name, trailing in _TRAILING.items()}}
        columns = {name: getattr(self, name) for name in axes}
        selected = {name: each[rows] if each.ndim > axes[name] else each for name, each in columns.items()}
        return Pose(**selected, time_std_s=np.broadcast_to(self.time_std_s, len(self.wxyz))[rows])

    @classmethod
    def concatenate(cls, poses: Sequence[Self]) -> Self:
        """Concatenate poses, single ones or ``(n,)``, ``(m,)``, ..., to ``(n + m + ...,)``.

        Poses without a covariance with the lens get 0 where others have one.
        """
        lens_columns = max((pose.lens_cov.shape[-1] for pose in poses), default=0)
        shapes = {**_TRAILING, "lens_cov": (6, lens_columns), "time_std_s": ()}
        ends = np.cumsum([0, *(pose.wxyz.size // 4 for pose in poses)]).tolist()
        columns_of = {name: np.zeros((ends[-1], *shape)) for name, shape in shapes.items()}
        for pose, start, stop in zip(poses, ends, ends[1:], strict=False):
            for name, values in columns_of.items():
                if name != "lens_cov" or pose.lens_cov.size:
                    values[start:stop] = getattr(pose, name)
        return cls(**columns_of)


class HeightSource(str):
    """Name of the source of a height above the measured plane.

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


class GimbalSource(str):
    """Name of the source of the camera's attitude.

    No enumeration: who adds a source to ``service.GIMBAL_SOURCES`` gives it a name there.
    """

    __slots__ = ()
    GIMBAL_DEVICE: ClassVar["GimbalSource"]
    MOUNT_ORIENTATION: ClassVar["GimbalSource"]
    MOUNT_STATUS: ClassVar["GimbalSource"]
    DATAFLASH_MNT: ClassVar["GimbalSource"]
    FIXED_MOUNT: ClassVar["GimbalSource"]
    PHOTOGRAPH: ClassVar["GimbalSource"]
    SUBTITLES: ClassVar["GimbalSource"]
    TABLE: ClassVar["GimbalSource"]
    KLV: ClassVar["GimbalSource"]
    MANUAL: ClassVar["GimbalSource"]


GimbalSource.GIMBAL_DEVICE = GimbalSource("GIMBAL_DEVICE_ATTITUDE_STATUS")
GimbalSource.MOUNT_ORIENTATION = GimbalSource("MOUNT_ORIENTATION")
GimbalSource.MOUNT_STATUS = GimbalSource("MOUNT_STATUS")
GimbalSource.DATAFLASH_MNT = GimbalSource("MNT")
GimbalSource.FIXED_MOUNT = GimbalSource("fixed")
GimbalSource.PHOTOGRAPH = GimbalSource("photograph")
GimbalSource.SUBTITLES = GimbalSource("subtitles")
GimbalSource.TABLE = GimbalSource("table")
GimbalSource.KLV = GimbalSource("klv")
GimbalSource.MANUAL = GimbalSource("manual")


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseStd:
    """Standard deviations for people: small rotations about the camera's x, y, z axes and the vertical."""

    height_agl_m: float = 0.0
    horizontal_m: float = 0.0
    tilt_rad: float = 0.0
    pan_rad: float = 0.0
    roll_rad: float = 0.0
    heading_rad: float = 0.0
    time_s: float = 0.0

    @property
    def values(self) -> FloatArray:
        """Standard deviations ``(7,)`` in the order of their names."""
        return np.array([getattr(self, name) for name in STD_NAMES])


@dataclass(frozen=True, slots=True, kw_only=True)
class GeoOrigin:
    """The station's fixed ENU origin: a point of the measured plane (WGS84)."""

    lat_rad: float
    lon_rad: float
    alt_msl_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseSample:
    """The camera at one stamp with the source of each part; ``pose`` is None where ``status`` is not ok.

    ``datum_enu_m`` is the ENU height of the height's datum: 0 unless the ground is not level. ``zoom`` is the focal
    length reported by the vehicle, if it is followed; None where the camera file's applies. ``level`` is the water's
    at the stamp, which the pose's height then counts from; None where the measured plane is always the same.
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
    level: WaterLevel | None = None

    @property
    def plane_elevation_m(self) -> float:
        """Height of the measured plane above the station's elevation 0."""
        return 0.0 if self.level is None else self.level.elevation_m

    @property
    def lat_lon_alt(self) -> tuple[float | None, float | None, float | None]:
        """Latitude, longitude (rad) and altitude (m MSL), None where they are not known."""
        return self.lat_rad, self.lon_rad, self.alt_msl_m

    @property
    def cov(self) -> FloatArray | None:
        """Covariance ``(6, 6)`` of the pose, as ``Pose.cov``."""
        return None if self.pose is None else self.pose.cov


_Key = TypeVar("_Key", bound=Hashable)

STD_NAMES: Final = tuple(each.name for each in fields(PoseStd))
HORIZONTAL: Final = STD_NAMES.index("horizontal_m")
"""Column of ``PoseBatch.std`` that holds the position's standard deviation."""
TIME: Final = STD_NAMES.index("time_s")
"""Column of ``PoseBatch.std`` that holds the stamp's standard deviation."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseBatch(Batch, Sequence[PoseSample]):
    """Poses at ``n`` stamps: columns of numbers, and ``variants`` with all else, shared by many samples.

    Attributes:
        stamp_ns: ``(n,)`` UTC.
        pose: The ``(n,)`` poses with a covariance each; NaN where a sample has none.
        std: ``(n, 7)`` standard deviations in the order of the fields of ``PoseStd``.
        lat_lon_alt: ``(n, 3)`` latitude, longitude (rad), altitude (m MSL); NaN where unknown.
        height_age_s: ``(n,)`` time to the nearest height sample; NaN where unknown.
        telemetry_age_s: ``(n,)`` time to the nearest sample, of height or attitude, whichever is older; NaN if unknown.
        datum_enu_m: ``(n,)`` ENU height of the height's datum.
        zoom: ``(n, 2)`` magnification relative to the camera file and its std; NaN where the file applies.
        level: ``(n, 2)`` level of the water in its datum (m) and its std; NaN where there is none.
        variant_index: ``(n,)`` indices into ``variants``.
        variants: Samples without the numbers above: status, reasons, origin, sources, calibration; of the zoom only
            its source, of the level only what does not change with time.
    """

    stamp_ns: IntArray
    pose: Pose
    std: FloatArray
    lat_lon_alt: FloatArray
    height_age_s: FloatArray
    telemetry_age_s: FloatArray
    datum_enu_m: FloatArray
    zoom: FloatArray
    level: FloatArray
    variant_index: IntArray
    variants: tuple[PoseSample, ...]

    @staticmethod
    def from_samples(samples: Sequence[PoseSample]) -> "PoseBatch":
        """A batch of samples, in order."""
        variants, variant_index = _unique_variants([_variant(sample) for sample in samples])
        zooms = [(np.nan, np.nan) if s.zoom is None else (s.zoom.magnification, s.zoom.std) for s in samples]
        levels = [(np.nan, np.nan) if s.level is None else (s.level.level_m, s.level.std_m) for s in samples]
        return PoseBatch(
            stamp_ns=np.array([sample.stamp_ns for sample in samples], dtype=np.int64),
            pose=_stack_poses([sample.pose for sample in samples]),
            std=np.array([sample.std.values for sample in samples]).reshape(-1, len(STD_NAMES)),
            lat_lon_alt=_nan_for_none([sample.lat_lon_alt for sample in samples]).reshape(-1, 3),
            height_age_s=_nan_for_none([sample.height_age_s for sample in samples]),
            telemetry_age_s=_nan_for_none([sample.telemetry_age_s for sample in samples]),
            datum_enu_m=np.array([sample.datum_enu_m for sample in samples], dtype=np.float64),
            zoom=np.array(zooms).reshape(-1, 2),
            level=np.array(levels).reshape(-1, 2),
            variant_index=variant_index,
            variants=variants,
        )

    @classmethod
    def concatenate(cls, batches: Sequence[Self]) -> Self:
        """Concatenate batches."""
        if len(batches) == 1:
            return batches[0]
        variants, index = _unique_variants([variant for batch in batches for variant in batch.variants])
        firsts = np.cumsum([0, *(len(batch.variants) for batch in batches)]).tolist()
        sample_index = [index[first + batch.variant_index] for batch, first in zip(batches, firsts[:-1], strict=True)]
        joined = super(PoseBatch, cls).concatenate(batches)
        return replace(joined, variant_index=np.concatenate(sample_index), variants=variants)

    @staticmethod
    def repeated(sample: PoseSample, stamps_ns: IntArray) -> "PoseBatch":
        """One sample at every stamp ``(n,)``: the pose of a fixed camera."""
        single = PoseBatch.from_samples([sample])
        return replace(single.rows(np.zeros(len(stamps_ns), dtype=np.int64)), stamp_ns=stamps_ns)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @overload
    def __getitem__(self, index: int) -> PoseSample: ...

    @overload
    def __getitem__(self, index: slice) -> "PoseBatch": ...

    def __getitem__(self, index: int | slice) -> "PoseSample | PoseBatch":
        if isinstance(index, slice):
            return self.rows(index)
        return self._sample(range(len(self))[index])

    def __iter__(self) -> Iterator[PoseSample]:
        return map(self._sample, range(len(self)))

    @property
    def status(self) -> IntArray:
        """Statuses ``(n,)`` as indices into ``CODES``."""
        return self.by_variant(lambda variant: CODE_OF[variant.status])

    @property
    def kind_index(self) -> IntArray:
        """Kinds ``(n,)`` of samples: those of a kind differ in numbers, reasons and calibration only."""
        kinds: dict[Hashable, int] = {}
        stripped = [replace(variant, reasons=(), calibration=None) for variant in self.variants]
        return np.array([kinds.setdefault(_key(each), len(kinds)) for each in stripped], dtype=np.int64)[
            self.variant_index
        ]

    @property
    def variant_of_each(self) -> list[PoseSample]:
        """Variants of the ``n`` samples."""
        return [self.variants[index] for index in self.variant_index.tolist()]

    @property
    def has_pose(self) -> BoolArray:
        """Whether a sample has a pose ``(n,)``, whatever its status."""
        return ~np.isnan(self.pose.wxyz[:, 0])

    @property
    def is_ok(self) -> BoolArray:
        """Whether a sample has a pose that can be measured with, ``(n,)``."""
        return np.asarray((self.status == CODE_OF[Status.OK]) & self.has_pose)

    @property
    def plane_elevation_m(self) -> FloatArray:
        """Heights ``(n,)`` of the measured plane above the station's elevation 0."""
        zero_m = np.array([0.0 if each.level is None else each.level.zero_m for each in self.variants])
        return np.where(np.isnan(self.level[:, 0]), 0.0, self.level[:, 0] - zero_m[self.variant_index])

    @property
    def level_std_m(self) -> FloatArray:
        """Standard deviations ``(n,)`` of the measured plane's level, 0 where it is always the same."""
        return np.where(np.isnan(self.level[:, 1]), 0.0, self.level[:, 1])

    @property
    def has_own_height(self) -> BoolArray:
        """Whether a height ``(n,)`` was measured to the water itself, so that the level's error is not in it."""
        return self.by_variant(lambda variant: variant.level is not None and variant.level.is_height_own) > 0

    def where(self, chosen: BoolArray, change: Callable[["PoseBatch", IntArray], "PoseBatch"]) -> "PoseBatch":
        """The batch with the samples ``chosen (n,)`` changed.

        Args:
            chosen: Samples to change.
            change: Maps one sample or more, with their rows in this batch, to as many.
        """
        rows = np.flatnonzero(chosen)
        if len(rows) == len(self):
            return change(self, rows)
        if not len(rows):
            return self
        order = np.arange(len(self))
        order[rows] = len(self) + np.arange(len(rows))
        return PoseBatch.concatenate([self, change(self.rows(rows), rows)]).rows(order)

    def by_variant(self, value: Callable[[PoseSample], int]) -> IntArray:
        """A whole number for each sample ``(n,)``, computed from its variant; unused variants are skipped."""
        used = np.zeros(len(self.variants), dtype=np.bool_)
        used[self.variant_index] = True
        numbers = np.zeros(len(self.variants), dtype=np.int64)
        numbers[used] = [value(self.variants[k]) for k in np.flatnonzero(used).tolist()]
        return numbers[self.variant_index]

    def map_variants(self, change: Callable[[PoseSample], PoseSample]) -> "PoseBatch":
        """The batch with every variant changed."""
        return replace(self, variants=tuple(map(change, self.variants)))

    def with_variants(
        self, keys: Sequence[_Key | None], change: Callable[[PoseSample, _Key], PoseSample]
    ) -> "PoseBatch":
        """The batch with variants changed by a key for each sample.

        Args:
            keys: ``n`` keys on which a sample's new variant depends; None keeps the present one.
            change: Makes a new variant from a present one and a key.
        """
        pairs = list(zip(self.variant_index.tolist(), keys, strict=True))
        numbers = {pair: number for number, pair in enumerate(dict.fromkeys(pairs))}
        variants = [self.variants[k] if key is None else change(self.variants[k], key) for k, key in numbers]
        variant_index = np.array([numbers[pair] for pair in pairs], dtype=np.int64)
        return replace(self, variants=tuple(variants), variant_index=variant_index)

    def without_poses(self) -> "PoseBatch":
        """The batch with all poses unknown."""
        return replace(self, pose=_stack_poses([None]).rows(np.zeros(len(self), dtype=np.int64)))

    def _sample(self, row: int) -> PoseSample:
        variant = self.variants[int(self.variant_index[row])]
        lat, lon, alt = (_none_if_nan(value) for value in self.lat_lon_alt[row].tolist())
        magnification, std = self.zoom[row].tolist()
        zoom = None if variant.zoom is None else Zoom(magnification=magnification, std=std, source=variant.zoom.source)
        level_m, level_std_m = self.level[row].tolist()
        level = None if variant.level is None else replace(variant.level, level_m=level_m, std_m=level_std_m)
        return replace(
            variant,
            stamp_ns=int(self.stamp_ns[row]),
            pose=None if np.isnan(self.pose.wxyz[row, 0]) else self.pose.rows(row),
            std=PoseStd(**dict(zip(STD_NAMES, self.std[row].tolist(), strict=True))),
            lat_rad=lat,
            lon_rad=lon,
            alt_msl_m=alt,
            height_age_s=_none_if_nan(float(self.height_age_s[row])),
            telemetry_age_s=_none_if_nan(float(self.telemetry_age_s[row])),
            datum_enu_m=float(self.datum_enu_m[row]),
            zoom=zoom,
            level=level,
        )


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
    """The sample's variant: the sample without its numbers."""
    zoom = None if sample.zoom is None else Zoom(magnification=np.nan, std=np.nan, source=sample.zoom.source)
    level = None if sample.level is None else replace(sample.level, level_m=np.nan, std_m=np.nan)
    return PoseSample(stamp_ns=0, **{name: getattr(sample, name) for name in _KEY_FIELDS}, zoom=zoom, level=level)


def _unique_variants(variants: Sequence[PoseSample]) -> tuple[tuple[PoseSample, ...], IntArray]:
    """Unique variants, and the index ``(n,)`` of each given one among them."""
    keys = [_key(variant) for variant in variants]
    numbers = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    by_key = dict(zip(keys, variants, strict=True))
    return tuple(by_key[key] for key in numbers), np.array([numbers[key] for key in keys], dtype=np.int64)


def _key(variant: PoseSample) -> Hashable:
    fields_of = (getattr(variant, name) for name in _KEY_FIELDS)
    level = variant.level
    of_level = None if level is None else (level.zero_m, level.datum, level.source, level.is_height_own)
    return (*fields_of, None if variant.zoom is None else variant.zoom.source, of_level)


_NO_POSE: Final = Pose(position_enu_m=np.full(3, np.nan), wxyz=np.full(4, np.nan), cov=np.full((6, 6), np.nan))


def _stack_poses(poses: Sequence[Pose | None]) -> Pose:
    return Pose.concatenate([_NO_POSE if pose is None else pose for pose in poses])


def _nan_for_none(values: Sequence[object]) -> FloatArray:
    """Array of numbers with NaN for None."""
    return np.array(values, dtype=np.float64)


def _none_if_nan(value: float) -> float | None:
    return None if np.isnan(value) else value


_DISAGREEMENT_STDS: Final = 1.96
"""Two height sources disagree where 0 is outside the 95 % interval of their difference."""

CONTRADICTION_STDS: Final = 5.0
"""Two height sources contradict each other beyond it: by chance once in two million comparisons."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightDifference:
    """Heights of two sources at one stamp.

    Attributes:
        stamp_ns: UTC.
        source: The first source.
        other: The second source.
        height_m: By ``source``, above the measured plane.
        other_m: By ``other``, above the measured plane.
        std_m: Standard deviation of the difference, from those stated of the sources.
    """

    stamp_ns: int
    source: HeightSource
    other: HeightSource
    height_m: float
    other_m: float
    std_m: float

    @property
    def step_m(self) -> float:
        """Height by ``other`` minus height by ``source``."""
        return self.other_m - self.height_m

    @property
    def is_significant(self) -> bool:
        """Whether the sources disagree: their step exceeds its 95 % interval."""
        return bool(self.is_step_significant(np.array(self.step_m), np.array(self.std_m)))

    @property
    def is_contradiction(self) -> bool:
        """Whether the sources contradict each other: at least one of them is wrong."""
        return abs(self.step_m) > CONTRADICTION_STDS * self.std_m

    @staticmethod
    def is_step_significant(step_m: FloatArray, std_m: FloatArray) -> BoolArray:
        """Whether steps ``(n,)`` exceed the 95 % interval of their standard deviations ``(n,)``."""
        return np.asarray(np.abs(step_m) > _DISAGREEMENT_STDS * std_m)

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
        """The difference as a sentence."""
        return (
            f"{self.other} says {self.other_m:.2f} m where {self.source} says {self.height_m:.2f} m: "
            f"{abs(self.step_m):.2f} m apart, their std is {self.std_m:.2f} m"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightSwitch:
    """Change of the height source at a stamp (UTC).

    ``step`` compares the two (``source`` before, ``other`` after) at their last common time; None if there was none.
    """

    stamp_ns: int
    before: HeightSource
    after: HeightSource
    step: HeightDifference | None
