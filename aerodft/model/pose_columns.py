"""Poses at many stamps as columns; single samples are made when somebody asks for them."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import groupby
from typing import Final, TypeAlias, overload

import numpy as np

from aerodft.model.arrays import FloatArray, IntArray
from aerodft.model.pose import HeightSource, Pose, PoseSample, PoseStd
from aerodft.model.status import Status

_STDS: Final = tuple(each.name for each in fields(PoseStd))
HORIZONTAL: Final = _STDS.index("horizontal_m")
"""Of the columns of ``PoseColumns.std``."""
TIME: Final = _STDS.index("time_s")
"""Likewise."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseColumns:
    """Poses at ``n`` stamps: all of them are ok, none is zoomed; numbers as in ``PoseSample``.

    Attributes:
        stamp_ns: ``(n,)``.
        pose: The ``(n,)`` poses.
        std: ``(n, 7)`` in the order of the fields of ``PoseStd``.
        lat_lon_alt: ``(n, 3)`` latitude, longitude (rad), altitude (m MSL); None where the place is not known.
        height_age_s: ``(n,)``.
        telemetry_age_s: ``(n,)``.
        which: ``(n,)`` which of ``alike`` each is.
        alike: Samples without these numbers.
    """

    stamp_ns: IntArray
    pose: Pose
    std: FloatArray
    lat_lon_alt: FloatArray | None
    height_age_s: FloatArray
    telemetry_age_s: FloatArray
    which: IntArray
    alike: tuple[PoseSample, ...]

    def sample(self, row: int) -> PoseSample:
        """One of them."""
        lat, lon, alt = self.place(row)
        return replace(
            self.alike[int(self.which[row])],
            stamp_ns=int(self.stamp_ns[row]),
            pose=self.pose.row(row),
            std=PoseStd(**dict(zip(_STDS, self.std[row].tolist(), strict=True))),
            lat_rad=lat,
            lon_rad=lon,
            alt_msl_m=alt,
            height_age_s=float(self.height_age_s[row]),
            telemetry_age_s=float(self.telemetry_age_s[row]),
        )

    def place(self, row: int) -> tuple[float | None, float | None, float | None]:
        """As ``PoseSample.lat_lon_alt`` of one of them."""
        if self.lat_lon_alt is None:
            return None, None, None
        lat_rad, lon_rad, alt_msl_m = self.lat_lon_alt[row].tolist()
        return lat_rad, lon_rad, alt_msl_m


class PoseRow:
    """One of such poses; what all have in common can be asked for without making the sample.

    Attributes:
        columns: All of them.
        row: Which.
    """

    __slots__ = ("columns", "row")

    def __init__(self, columns: PoseColumns, row: int) -> None:
        self.columns = columns
        self.row = row

    @property
    def sample(self) -> PoseSample:
        """The sample, made anew."""
        return self.columns.sample(self.row)

    @property
    def stamp_ns(self) -> int:
        """As in ``PoseSample``."""
        return int(self.columns.stamp_ns[self.row])

    @property
    def alike(self) -> PoseSample:
        """The sample without its numbers."""
        return self.columns.alike[int(self.columns.which[self.row])]

    @property
    def lat_lon_alt(self) -> tuple[float | None, float | None, float | None]:
        """As in ``PoseSample``."""
        return self.columns.place(self.row)

    @property
    def cov(self) -> FloatArray | None:
        """As in ``PoseSample``."""
        cov: FloatArray = self.columns.pose.cov[self.row]
        return cov

    @property
    def status(self) -> Status:
        """As in ``PoseSample``: that of all rows."""
        return Status.OK

    @property
    def reasons(self) -> tuple[str, ...]:
        """As in ``PoseSample``."""
        return self.alike.reasons

    @property
    def height_source(self) -> HeightSource | None:
        """As in ``PoseSample``."""
        return self.alike.height_source

    @property
    def calibration(self) -> str | None:
        """As in ``PoseSample``."""
        return self.alike.calibration


class PoseRows(Sequence[PoseRow]):
    """Some of such poses, in any order.

    Attributes:
        columns: All of them.
        rows: ``(n,)`` which.
    """

    __slots__ = ("columns", "rows")

    def __init__(self, columns: PoseColumns, rows: IntArray) -> None:
        self.columns = columns
        self.rows = rows

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, index: int) -> PoseRow: ...

    @overload
    def __getitem__(self, index: slice) -> "PoseRows": ...

    def __getitem__(self, index: int | slice) -> "PoseRow | PoseRows":
        if isinstance(index, slice):
            return PoseRows(self.columns, self.rows[index])
        return PoseRow(self.columns, int(self.rows[index]))

    @property
    def stamp_ns(self) -> IntArray:
        """``(n,)``."""
        return self.columns.stamp_ns[self.rows]

    @property
    def which(self) -> IntArray:
        """``(n,)`` which of ``columns.alike`` each is."""
        return self.columns.which[self.rows]


Posed: TypeAlias = PoseSample | PoseRow
"""A pose that was made alone, or together with others."""
POSED: Final = (PoseSample, PoseRow)
"""The same to ask an instance for."""


def sample_of(posed: Posed) -> PoseSample:
    """A sample, made where it is a row."""
    return posed.sample if isinstance(posed, PoseRow) else posed


def by_columns(rows: Iterable[PoseRow]) -> Iterator[tuple[PoseColumns, IntArray]]:
    """Rows that stand together in their columns, and which of these they are ``(n,)``."""
    for _, group in groupby(rows, key=lambda each: id(each.columns)):
        own = list(group)
        yield own[0].columns, np.array([each.row for each in own])
