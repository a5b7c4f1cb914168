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
class Asked:
    """What is asked of a gimbal.

    Attributes:
        stamps_ns: ``(n,)`` UTC.
        ticks: ``(n,)`` as of which each is asked.
        found: The gimbal's samples around the stamps, all of which are known.
        vehicle: The vehicle's samples around them.
    """

    stamps_ns: IntArray
    ticks: IntArray
    found: Brackets
    vehicle: Brackets

    def rows(self, rows: IntArray) -> "Asked":
        """Some of it."""
        return Asked(self.stamps_ns[rows], self.ticks[rows], self.found.rows(rows), self.vehicle.rows(rows))


class _Way(NamedTuple):
    """What reports have in common that are read in one way."""

    frame: ReportFrame
    is_body_found: bool
    is_demand: bool
    yaw_in_earth: bool
    has_vehicle: bool


def refusal(source: GimbalSource, evidence: FrameEvidence, stated: ReportFrame | None) -> str | None:
    """Why reports cannot be read as stated, or cannot be read at all, in a sentence; None where they can."""
    if stated is ReportFrame.EARTH and evidence.frame is ReportFrame.BODY:
        return (
            f"{source} is body-frame (against the vehicle, not the horizon): it undid {evidence.undone} of the "
            f"vehicle's {evidence.motions} motions; "
            'set telemetry.attitude.frame = "auto" or "body"'
        )
    if stated is None and evidence.contradictory:
        return (
            f"{source} is earth-frame (against the horizon) at times and body-frame (against the vehicle) at others; "
            'set telemetry.attitude.frame = "earth" or "body"'
        )
    return None


def readings_of(
    source: GimbalSource, gimbal: Gimbal, vehicle: Stream, stated: ReportFrame | None, asked: Asked
) -> Iterator[tuple[IntArray, Readings]]:
    """Readings of reports, with the rows of what was asked that they answer.

    Args:
        source: The message.
        gimbal: Its reports.
        vehicle: The vehicle's attitude.
        stated: What roll and pitch are against, where that is not to be found.
        asked: What is asked; its reports can be read.
    """
    in_earth, _ = asked.found.ends(gimbal.stream.column("yaw_in_earth"))
    known, which = gimbal.evidence_at(vehicle, asked.ticks)
    probability = np.zeros(len(which))
    rows_of: dict[_Way, list[IntArray]] = {}
    for number in np.unique(which).tolist():
        evidence = known[number]
        rows = np.flatnonzero(which == number)
        if stated is None and evidence.frame is None:
            probability[rows] = evidence.body_probability
        is_body_found = stated is None and evidence.frame is ReportFrame.BODY
        is_demand = gimbal.is_demand(evidence.frame, asked.ticks[rows])
        bits = is_demand, in_earth[rows] > 0, asked.vehicle.is_known[rows]
        ways = [_Way(stated or evidence.frame or ReportFrame.EARTH, is_body_found, *each) for each in _combined(*bits)]
        for way in ways:
            alike = np.all([bit == wanted for bit, wanted in zip(bits, way[2:], strict=True)], axis=0)
            rows_of.setdefault(way, []).append(rows[alike])
    for way, parts in rows_of.items():
        rows = np.concatenate(parts)
        own = asked.rows(rows)
        ends = Ends.of(vehicle.column("wxyz"), own.vehicle) if way.has_vehicle else None
        yield rows, _read(source, gimbal, way, own, ends, probability[rows])


def _combined(*bits: BoolArray) -> list[tuple[bool, ...]]:
    """The combinations that occur in columns ``(n,)``."""
    return sorted(set(zip(*(column.tolist() for column in bits), strict=True)))


def _read(
    source: GimbalSource, gimbal: Gimbal, way: _Way, asked: Asked, vehicle: Ends | None, body_probability: FloatArray
) -> Readings:
    stream, reported, found = gimbal.stream, gimbal.stream.column("wxyz"), asked.found
    has_previous = found.before > stream.rows_known_at(asked.ticks)[0]
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
