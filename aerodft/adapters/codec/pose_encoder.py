"""Many poses as ``aerodft.pose/1``, and their summaries in measurements, in one go."""

from collections.abc import Callable, Hashable, Sequence
from functools import cached_property
from itertools import chain
from typing import Final, NamedTuple

import numpy as np

from aerodft.adapters.codec import wire
from aerodft.adapters.codec.angles import camera_angles_deg
from aerodft.adapters.codec.pose import origin_payload, payload_of
from aerodft.adapters.codec.pose_summary import summary_key, summary_of, summary_values
from aerodft.adapters.codec.template import Alike, Templates
from aerodft.adapters.texts import Texts
from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.pose import GeoOrigin, PoseSample
from aerodft.model.pose_columns import HORIZONTAL, TIME, PoseColumns, Posed, PoseRow, PoseRows, by_columns, sample_of

_REMEMBERED: Final = 1024  # summaries
_REMEMBERED_COLUMNS: Final = 2
_ARRAYS: Final = ("position_enu_m", "wxyz", "cov", "velocity_enu_mps", "rate_cam_radps")
_NOT_IN_SUMMARIES: Final = [HORIZONTAL, TIME]  # of the standard deviations


class PoseEncoder:
    """Encodes poses, of which many are alike but for their numbers; their summaries are made once.

    Not shared between threads.
    """

    def __init__(self) -> None:
        self._templates = Templates(whole=("stamp_ns",))
        self._summaries: dict[int, _Summary] = {}
        self._columns: dict[int, Columns] = {}

    def encode(self, poses: Sequence[Posed]) -> Texts:
        """Poses as ``aerodft.pose/1``."""
        return self._templates.written(poses, self.key, self._payload, _stamps, self._numbers)

    def encode_rows(self, poses: PoseRows) -> Texts:
        """The same of poses that were made together."""
        columns = self.columns(poses.columns)
        return self._templates.joined([self._alike(columns, poses, own) for own in groups(poses.which)])

    def _alike(self, columns: "Columns", poses: PoseRows, own: IntArray) -> Alike:
        rows = PoseRows(poses.columns, poses.rows[own])
        return Alike(
            own,
            columns.keys[int(rows.which[0])],
            lambda row: self._payload(rows[row]),
            lambda: rows.stamp_ns[:, None],
            lambda: columns.numbers[rows.rows],
        )

    def key(self, posed: Posed) -> Hashable | None:
        """What poses have in common that are written with one template; None for one that is written alone."""
        if isinstance(posed, PoseRow):
            return self.columns(posed.columns).keys[int(posed.columns.which[posed.row])]
        return None if posed.pose is None or posed.zoom is not None else _key(posed)

    def summary(self, posed: Posed) -> wire.Json:
        """As a measurement shows the pose; not to be changed."""
        sample = sample_of(posed)
        return summary_of(sample, self._summary(sample).values)

    def summary_numbers(self, poses: Sequence[Posed]) -> FloatArray:
        """Those of summaries ``(n, m)`` of poses with one key, in their order."""
        return self._gathered(poses, lambda columns: columns.summary, self._sample_summary)

    def _sample_summary(self, sample: PoseSample) -> list[float]:
        return [value for value in self._summary(sample).values if value is not None]

    def _summary(self, sample: PoseSample) -> "_Summary":
        known = self._summaries.get(id(sample))
        if known is not None and known.sample is sample:
            return known
        if len(self._summaries) >= _REMEMBERED:
            self._summaries.clear()
        self._summaries[id(sample)] = known = _Summary(sample, summary_values(sample))
        return known

    def columns(self, columns: PoseColumns) -> "Columns":
        """What is written of poses that were made together."""
        known = self._columns.get(id(columns))
        if known is None or known.columns is not columns:
            if len(self._columns) >= _REMEMBERED_COLUMNS:
                self._columns.clear()
            self._columns[id(columns)] = known = Columns(columns)
        return known

    def _payload(self, posed: Posed) -> wire.Json:
        return payload_of(sample_of(posed), self.summary(posed))

    def _numbers(self, poses: Sequence[Posed]) -> FloatArray:
        return self._gathered(poses, lambda columns: columns.numbers, self._sample_numbers)

    def _sample_numbers(self, sample: PoseSample) -> list[float]:
        """Those of one payload, in their order."""
        pose, altitude = sample.pose, () if sample.alt_msl_m is None else (sample.alt_msl_m,)
        assert pose is not None  # noqa: S101 - by its key, for the type checker
        arrays = chain(*(np.ravel(getattr(pose, name)).tolist() for name in _ARRAYS))
        scalars = *self._sample_summary(sample), sample.std.horizontal_m, sample.std.time_s, *altitude
        return [*scalars, *arrays, float(pose.time_std_s), *_origin_numbers(sample.origin)]

    def _gathered(
        self,
        poses: Sequence[Posed],
        of_columns: "Callable[[Columns], FloatArray]",
        of_sample: Callable[[PoseSample], list[float]],
    ) -> FloatArray:
        """Numbers ``(n, m)`` of poses with one key, in their order: all of them are rows, or none."""
        rows = [posed for posed in poses if isinstance(posed, PoseRow)]
        if rows:
            return np.concatenate([of_columns(self.columns(columns))[own] for columns, own in by_columns(rows)])
        return np.array([of_sample(sample_of(posed)) for posed in poses])


class _Summary(NamedTuple):
    sample: PoseSample
    values: list[float | None]


class Columns:
    """Columns of poses with what is written of them.

    Attributes:
        columns: The poses.
        keys: By what the rows are written that are like each of ``columns.alike``.
    """

    def __init__(self, columns: PoseColumns) -> None:
        self.columns = columns
        has_place = columns.lat_lon_alt is not None
        self.keys = [(PoseRow, has_place, *_key(sample)) for sample in columns.alike]

    @cached_property
    def summary(self) -> FloatArray:
        """``(n, m)`` as ``summary_values``."""
        columns = self.columns
        angles_deg = np.array([camera_angles_deg(*wxyz) for wxyz in columns.pose.wxyz.tolist()])
        places = () if columns.lat_lon_alt is None else np.degrees(columns.lat_lon_alt[:, :2]).T
        height_std_m, _, *stds_rad, _ = columns.std.T
        parts = (columns.pose.position_enu_m[:, 2], columns.height_age_s, *angles_deg.T, *places)
        return np.stack([*parts, columns.telemetry_age_s, height_std_m, *np.degrees(stds_rad)], axis=1)

    @cached_property
    def numbers(self) -> FloatArray:
        """``(n, m)`` as they stand in ``aerodft.pose/1``; the origin is that of all of them."""
        columns, pose, origin = self.columns, self.columns.pose, self.columns.alike[0].origin
        parts = [self.summary, columns.std[:, _NOT_IN_SUMMARIES]]
        if columns.lat_lon_alt is not None:
            parts.append(columns.lat_lon_alt[:, 2:])
        parts += [np.reshape(getattr(pose, name), (len(self.summary), -1)) for name in _ARRAYS]
        for same in (pose.time_std_s, *_origin_numbers(origin)):
            parts.append(np.full((len(self.summary), 1), same))
        return np.concatenate(parts, axis=1)


def _stamps(poses: Sequence[Posed]) -> IntArray:
    return np.array([posed.stamp_ns for posed in poses], dtype=np.int64)[:, None]


def groups(values: IntArray) -> list[IntArray]:
    """For each of the different values ``(n,)``, where it stands."""
    return [np.flatnonzero(values == value) for value in np.unique(values).tolist()]


def _origin_numbers(origin: GeoOrigin | None) -> list[float]:
    return [] if origin is None else [each for each in origin_payload(origin).values() if each is not None]


def _key(sample: PoseSample) -> tuple[Hashable, ...]:
    """What samples have in common that are written with one template."""
    own = (sample.status, sample.reasons, sample.alt_msl_m is None, sample.attitude_source, sample.calibration)
    origin = sample.origin
    place = None if origin is None else (origin.lat_rad, origin.lon_rad, origin.alt_msl_m)
    return (*summary_key(sample), *own, place)
