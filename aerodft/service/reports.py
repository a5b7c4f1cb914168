"""Reports of one gimbal around many stamps, told apart by the way in which they must be read."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aerodft.geometry.interpolation import Brackets
from aerodft.model.arrays import BoolArray, FloatArray, IntArray
from aerodft.model.pose import GimbalSource
from aerodft.model.telemetry import ReportFrame
from aerodft.service.attitude_readings import Readings
from aerodft.service.carried import Ends
from aerodft.service.gimbal import Gimbal
from aerodft.service.gimbal_frame import FrameEvidence
from aerodft.service.streams import Stream


@dataclass(frozen=True, slots=True)
class Refused:
    """There are reports, and they cannot be believed: ``reason`` says why, in a sentence."""

    reason: str


@dataclass(frozen=True, slots=True)
class Asked:
    """What is asked of a gimbal.

    Attributes:
        stamps_ns: ``(n,)`` UTC.
        ticks: ``(n,)`` those of the ticks that came last by which it is asked.
        is_over: ``(n,)`` whether nothing of the vehicle is waited for: where it is not known, it is left out.
    """

    stamps_ns: IntArray
    ticks: IntArray
    is_over: BoolArray

    def rows(self, rows: IntArray) -> "Asked":
        """Some of it."""
        return Asked(self.stamps_ns[rows], self.ticks[rows], self.is_over[rows])


class _Way(NamedTuple):
    """What reports have in common that are read in one way."""

    frame: ReportFrame
    is_body_found: bool
    is_demand: bool
    yaw_in_earth: bool
    has_vehicle: bool


def refused(source: GimbalSource, evidence: FrameEvidence, stated: ReportFrame | None) -> Refused | None:
    """Why reports cannot be read as stated, or cannot be read at all."""
    if stated is ReportFrame.EARTH and evidence.frame is ReportFrame.BODY:
        return Refused(
            f"{source} is body-frame (against the vehicle, not the horizon): it undid {evidence.undone} of the "
            f"vehicle's {evidence.motions} motions; "
            'set telemetry.attitude.frame = "auto" or "body"'
        )
    if stated is None and evidence.contradictory:
        return Refused(
            f"{source} is earth-frame (against the horizon) at times and body-frame (against the vehicle) at others; "
            'set telemetry.attitude.frame = "earth" or "body"'
        )
    return None


def readings_of(
    source: GimbalSource, gimbal: Gimbal, vehicle: Stream, stated: ReportFrame | None, asked: Asked
) -> Iterator[tuple[IntArray, Readings]]:
    """Readings, with the rows of what was asked that they answer: those that can be read.

    Args:
        source: The message.
        gimbal: Its reports.
        vehicle: The vehicle's attitude.
        stated: What roll and pitch are against, where that is not to be found.
        asked: What is asked.
    """
    stream = gimbal.stream
    found, carrier = (each.find_all(asked.stamps_ns, asked.ticks) for each in (stream, vehicle))
    before, after = found.ends(stream.all_of("yaw_in_earth"))
    is_open = found.is_known & (before == after) & (carrier.is_known | asked.is_over)
    known, which = gimbal.evidence_at(vehicle, asked.ticks)
    probability = np.zeros(len(is_open))
    rows_of: dict[_Way, list[IntArray]] = {}
    for number in np.unique(which[is_open]).tolist():
        evidence = known[number]
        rows = np.flatnonzero(is_open & (which == number))
        if refused(source, evidence, stated) is not None:
            continue
        if stated is None and evidence.frame is None:
            probability[rows] = evidence.body_probability
        is_body_found = stated is None and evidence.frame is ReportFrame.BODY
        bits = gimbal.is_demand_at(evidence.frame, asked.ticks[rows]), before[rows] > 0, carrier.is_known[rows]
        ways = [_Way(stated or evidence.frame or ReportFrame.EARTH, is_body_found, *each) for each in _combined(*bits)]
        for way in ways:
            alike = np.all([bit == wanted for bit, wanted in zip(bits, way[2:], strict=True)], axis=0)
            rows_of.setdefault(way, []).append(rows[alike])
    for way, parts in rows_of.items():
        if way.has_vehicle or (way.yaw_in_earth and way.frame is ReportFrame.EARTH):
            rows = np.concatenate(parts)
            own = carrier.rows(rows) if way.has_vehicle else None
            ends = None if own is None else Ends.of(vehicle.all_of("wxyz"), own)
            yield rows, _read(source, gimbal, way, asked.rows(rows), found.rows(rows), ends, probability[rows])


def _combined(*bits: BoolArray) -> list[tuple[bool, ...]]:
    """The combinations that occur in columns ``(n,)``."""
    return sorted(set(zip(*(column.tolist() for column in bits), strict=True)))


def _read(
    source: GimbalSource,
    gimbal: Gimbal,
    way: _Way,
    asked: Asked,
    found: Brackets,
    vehicle: Ends | None,
    body_probability: FloatArray,
) -> Readings:
    stream, reported = gimbal.stream, gimbal.stream.all_of("wxyz")
    has_previous = found.before > stream.first_at(asked.ticks)
    demands = gimbal.demands(found.before, asked.stamps_ns, asked.ticks) if way.is_demand else None
    return Readings(
        source=source,
        age_s=stream.ages_s(asked.stamps_ns, found),
        report=Ends.of(reported, found),
        previous=np.where(has_previous[:, None], reported[found.before - 1], np.nan),
        vehicle=vehicle,
        frame=way.frame,
        yaw_in_earth=way.yaw_in_earth,
        demands=None if demands is None else (demands, reported),
        is_body_found=way.is_body_found,
        body_probability=body_probability,
    )
