"""Health of the vehicle and its link by a stamp, and what it means for poses."""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import pose_covariance
from aerodft.model import (
    CODE_OF,
    FIX_3D,
    HORIZONTAL,
    RATIOS,
    BoolArray,
    CameraTrack,
    ClimbTrack,
    ClockTrack,
    EstimatorTrack,
    FloatArray,
    GimbalFailureTrack,
    GimbalSource,
    GimbalTrack,
    GpsTrack,
    HeadingTrack,
    Health,
    HeartbeatTrack,
    HeightTrack,
    IntArray,
    LandedTrack,
    LinkTrack,
    OtherSenderTrack,
    PoseBatch,
    PoseSample,
    PositionTrack,
    ReceiverTrack,
    Status,
    Track,
    TriggerTrack,
    VehicleTrack,
)
from aerodft.service.gimbal_sources import GIMBAL_SOURCES
from aerodft.service.settings import HealthSettings
from aerodft.service.streams import Stream, TelemetryPart

_WARNING_FRACTION: Final = 0.8  # of the largest test ratio


def _may_be_of_failure(source: GimbalSource | None) -> bool:
    """Whether an attitude may be a report during a gimbal's failure, which its source does not mark."""
    reports = None if source is None else GIMBAL_SOURCES.get(source)
    return bool(reports and reports.is_reported and not (reports.is_own_statement or reports.has_failure_flags))


class _Facts(NamedTuple):
    """Facts that a verdict follows from; None for what was never reported.

    Attributes:
        is_silent: Whether the autopilot's HEARTBEAT has stopped.
        has_attitude: Whether the EKF has an attitude.
        ratios: The EKF's test ratios, by quantity.
        is_estimator_silent: Whether usable reports of the EKF have stopped.
        gps_fix: GPS_FIX_TYPE.
        is_gps_silent: Whether the receiver's reports have stopped.
        horizontal_std_m: Of the receiver's position.
        vertical_std_m: Of the receiver's altitude.
        lost_share: Lost fraction of the autopilot's frames where above the limit; else 0.
        failures: Recent failures reported by the gimbal.
        rivals: Recent messages of other senders.
    """

    is_silent: bool
    has_attitude: bool | None
    ratios: tuple[tuple[str, float], ...]
    is_estimator_silent: bool
    gps_fix: int | None
    is_gps_silent: bool
    horizontal_std_m: float | None
    vertical_std_m: float | None
    lost_share: float
    failures: tuple[str, ...]
    rivals: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Verdict:
    """Consequences of the vehicle's health for poses, while the facts do not change.

    Attributes:
        status: Of refused poses.
        faults: Sentences on why poses are refused.
        remarks: Sentences on what makes poses less certain.
        failures: As in ``_Facts``.
        rivals: As in ``_Facts``.
        horizontal_std_m: Smallest standard deviation of a position.
        has_place: Whether the receiver has a position.
    """

    status: Status
    faults: tuple[str, ...]
    remarks: tuple[str, ...]
    failures: tuple[str, ...]
    rivals: tuple[str, ...]
    horizontal_std_m: float
    has_place: bool

    @property
    def is_silent(self) -> bool:
        """Whether nothing follows, but for the smallest standard deviation of a position."""
        return self.has_place and not (self.faults or self.remarks or self.failures or self.rivals)

    def refuses(self, sample: PoseSample) -> bool:
        """Whether a pose that is ok is refused, by a fault or by a failure of its own gimbal."""
        return bool(self.faults) or (bool(self.failures) and _may_be_of_failure(sample.attitude_source))

    def apply_to(self, sample: PoseSample) -> PoseSample:
        """The sample's variant with the status, reasons and origin that follow."""
        if sample.status is not Status.OK:
            reasons = (*self.faults, *self.failures, *self.rivals)
            return replace(sample, reasons=(*sample.reasons, *reasons))
        if self.refuses(sample):
            rejected = tuple(f"{each}: its other reports are not believed" for each in self.failures)
            status = self.status if self.faults else Status.UNHEALTHY
            return replace(sample, status=status, reasons=(*(self.faults or rejected), *sample.reasons))
        remarks = (*self.remarks, *self.failures, *self.rivals)
        origin = sample.origin if self.has_place else None
        return replace(sample, origin=origin, reasons=(*sample.reasons, *remarks))


def _with_verdicts(poses: PoseBatch, verdicts: Sequence[_Verdict], verdict_index: IntArray) -> PoseBatch:
    """Poses ``(n,)`` with the verdicts of their indices ``(n,)`` applied."""
    refused = [[verdict.refuses(variant) for verdict in verdicts] for variant in poses.variants]
    is_refused = np.array(refused, dtype=np.bool_)[poses.variant_index, verdict_index]
    stays = (poses.status == CODE_OF[Status.OK]) & ~is_refused
    least_m = np.array([verdict.horizontal_std_m for verdict in verdicts])[verdict_index]
    has_place = np.array([verdict.has_place for verdict in verdicts], dtype=np.bool_)[verdict_index]
    widened = _with_horizontal_std(poses, stays & poses.has_pose & (least_m > poses.std[:, HORIZONTAL]), least_m)
    with_place = replace(widened, lat_lon_alt=np.where((stays & ~has_place)[:, None], np.nan, widened.lat_lon_alt))
    keys = [None if verdict.is_silent else verdict for verdict in verdicts]
    return with_place.with_variants(
        [keys[k] for k in verdict_index.tolist()], lambda sample, verdict: verdict.apply_to(sample)
    )


def _verdict_on(facts: _Facts, limits: HealthSettings) -> _Verdict:
    """Verdict from facts, by the limits."""
    status, faults = _faults(facts, limits)
    return _Verdict(
        status=status,
        faults=tuple(faults),
        remarks=tuple(_remarks(facts, limits)),
        failures=facts.failures,
        rivals=facts.rivals,
        horizontal_std_m=facts.horizontal_std_m or 0.0,
        has_place=facts.gps_fix is None or facts.gps_fix >= FIX_3D,
    )


def _is_unremarkable(ratios: FloatArray, has_attitude: FloatArray, limits: HealthSettings) -> BoolArray:
    """Whether nothing follows from EKF reports: test ratios ``(n, k)``, and whether there is an attitude."""
    return np.asarray((has_attitude != 0) & ~np.any(ratios >= _WARNING_FRACTION * limits.max_ratio, axis=1))


def _faults(facts: _Facts, limits: HealthSettings) -> tuple[Status, list[str]]:
    """Status and sentences of faults, for which poses are refused."""
    faults = []
    if facts.is_silent:
        faults.append(f"no HEARTBEAT of the autopilot for more than {limits.heartbeat_ns / SECOND_NS:g} s")
    status = Status.STALE_TELEMETRY if faults else Status.UNHEALTHY
    if facts.has_attitude is False:
        faults.append("the autopilot's estimator says that it has no attitude")
    faults += [
        f"the autopilot's estimator is at fault: its test ratio of {name} is {ratio:.2f}, below"
        f" {limits.max_ratio:g} is wanted"
        for name, ratio in facts.ratios
        if ratio >= limits.max_ratio
    ]
    return status, faults


def _remarks(facts: _Facts, limits: HealthSettings) -> list[str]:
    """Sentences on what makes poses less certain."""
    remarks = []
    if facts.gps_fix is not None and facts.gps_fix < FIX_3D:
        remarks.append(f"GPS has no 3D fix (fix type {facts.gps_fix}): the place is not known")
    if facts.is_gps_silent:
        remarks.append(f"GPS has been silent for more than {limits.gps_ns / SECOND_NS:g} s")
    for direction, std_m, limit_m in (
        ("horizontally", facts.horizontal_std_m, limits.horizontal_std_m),
        ("vertically", facts.vertical_std_m, limits.vertical_std_m),
    ):
        if std_m is not None and std_m > limit_m:
            remarks.append(f"GPS is accurate to {std_m:.1f} m {direction} only, at best {limit_m:g} m is wanted")
    if facts.is_estimator_silent:
        limit_s = limits.heartbeat_ns / SECOND_NS
        remarks.append(f"the autopilot's estimator has said nothing believable for more than {limit_s:g} s")
    remarks += [
        f"the autopilot's estimator is near its limit: its test ratio of {name} is {ratio:.2f}"
        for name, ratio in facts.ratios
        if ratio >= _WARNING_FRACTION * limits.max_ratio
    ]
    if facts.lost_share:
        share, seconds = round(100 * facts.lost_share), limits.window_ns / SECOND_NS
        remarks.append(f"the link lost {share} % of the autopilot's frames over {seconds:g} s")
    return remarks


def _with_horizontal_std(poses: PoseBatch, rows: BoolArray, min_std_m: FloatArray) -> PoseBatch:
    """Poses with the standard deviations ``min_std_m (n,)`` of their positions at some rows ``(n,)``."""
    indices = np.flatnonzero(rows)
    if not len(indices):
        return poses
    before, std = poses.std[indices], poses.std.copy()
    std[indices, HORIZONTAL] = min_std_m[indices]
    wxyz, cov = poses.pose.wxyz[indices], poses.pose.cov.copy()
    cov[indices] += pose_covariance(wxyz, std[indices]) - pose_covariance(wxyz, before)
    return replace(poses, std=std, pose=replace(poses.pose, cov=cov))


_LOG: Final = logging.getLogger(__name__)


class _RecentWarnings:
    """Sentences, logged when first heard, and given for every stamp up to ``window_ns`` later."""

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._streams: dict[str, Stream] = {}

    def streams(self) -> tuple[Stream, ...]:
        """All streams, to be cleared or shifted with the clocks."""
        return tuple(self._streams.values())

    def append(self, what: str, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Append the stamps at which a sentence held, as ``Stream.append``."""
        if what not in self._streams:
            _LOG.warning("%s", what)
            self._streams[what] = Stream(self._window_ns)
        self._streams[what].append(stamps_ns, row_end_by_tick)

    def before_each(self, stamps_ns: IntArray, ticks: IntArray) -> list[tuple[str, ...]]:
        """Sentences within the window before each stamp ``(n,)``, as of ticks ``(n,)``."""
        sentences: list[tuple[str, ...]] = [()] * len(stamps_ns)
        for what, each in self._streams.items():
            rows = each.last_before(stamps_ns, ticks)
            for k in np.flatnonzero(rows >= 0).tolist():
                if stamps_ns[k] - each.stamps_ns[rows[k]] <= self._window_ns:
                    sentences[k] = (*sentences[k], what)
        return sentences


_FAILURE_NS: Final = SECOND_NS  # for which a reported failure of the gimbal counts
_NEVER: Final = np.iinfo(np.int64).max
_OF_OTHER_TRACKS: Final = (HeadingTrack, ReceiverTrack)  # their messages have a track of their own
_TRACK_NAMES: Final = {
    ClockTrack: "clock",
    VehicleTrack: "vehicle attitude",
    PositionTrack: "position",
    HeartbeatTrack: "heartbeat",
    GpsTrack: "gps",
    EstimatorTrack: "estimator",
    ClimbTrack: "climb",
    LandedTrack: "landed",
}


class HealthSources(TelemetryPart):
    """Health reports of a vehicle, and the stamps of its latest telemetry of each kind."""

    def __init__(self, settings: HealthSettings) -> None:
        self._settings = settings
        self._window_ns = settings.window_ns
        self._kinds: dict[str, Stream] = {}
        self._heartbeat, self._gps = Stream(settings.heartbeat_ns), Stream(settings.gps_ns)
        self._estimator, self._link = Stream(settings.heartbeat_ns), Stream(settings.window_ns)
        self._resumed = Stream(settings.heartbeat_ns)  # ends of silences of the whole link
        self._rivals, self._failures = _RecentWarnings(settings.window_ns), _RecentWarnings(_FAILURE_NS)
        self._newest_ns: int | None = None

    def streams(self) -> tuple[Stream, ...]:
        """All streams, to be cleared or shifted with the clocks."""
        streams = (self._heartbeat, self._gps, self._estimator, self._link, self._resumed)
        return (*streams, *self._rivals.streams(), *self._failures.streams(), *self._kinds.values())

    def append(self, track: Track, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Append a track of any kind, as ``Stream.append``."""
        if isinstance(track, _OF_OTHER_TRACKS):
            return
        if isinstance(track, OtherSenderTrack | GimbalFailureTrack):
            warnings = self._rivals if isinstance(track, OtherSenderTrack) else self._failures
            warnings.append(track.what, stamps_ns, row_end_by_tick)
            return
        if len(stamps_ns):
            self._detect_silence(stamps_ns, row_end_by_tick)
        match track:
            case HeartbeatTrack():
                self._heartbeat.append(stamps_ns, row_end_by_tick)
            case GpsTrack():
                self._gps.append(
                    stamps_ns,
                    row_end_by_tick,
                    fix=track.fix,
                    satellites=track.satellites,
                    horizontal_std_m=track.horizontal_std_m,
                    vertical_std_m=track.vertical_std_m,
                )
            case EstimatorTrack():
                self._estimator.append(stamps_ns, row_end_by_tick, ratios=track.ratios, has_attitude=track.has_attitude)
            case LinkTrack():
                ends = np.array([len(stamps_ns)]) if row_end_by_tick is None else row_end_by_tick
                self._append_link(track, stamps_ns, ends)
                return
        self._kinds.setdefault(_name(track), Stream(self._settings.heartbeat_ns)).append(stamps_ns, row_end_by_tick)

    def may_append_ticks(self, track: Track) -> bool:
        """Whether a track of several ticks may be appended at once: its kind has been heard since clocks were set."""
        if isinstance(track, (LinkTrack, *_OF_OTHER_TRACKS)):
            return True
        return _name(track) in self._kinds and not self._kinds[_name(track)].is_empty

    def has_no_silence(self, stamps: Sequence[IntArray], row_ends: Sequence[IntArray]) -> bool:
        """Whether there is no silence before or within tracks of several ticks, from stamps ``(n,)`` and row ends."""
        newest, limit = self._newest_ns, self._settings.heartbeat_ns
        if newest is None:
            return False
        ticks = len(row_ends[0])
        firsts, lasts = np.full(ticks, newest), np.full(ticks, newest)
        for stamps_ns, ends in zip(stamps, row_ends, strict=True):
            starts = np.concatenate([[0], ends[:-1]])
            has_rows = np.flatnonzero(ends > starts)
            firsts[has_rows] = np.maximum(firsts[has_rows], stamps_ns[starts[has_rows]])
            lasts[has_rows] = np.maximum(lasts[has_rows], stamps_ns[ends[has_rows] - 1])
        before = np.concatenate([[newest], np.maximum.accumulate(lasts)[:-1]])
        return bool(np.all(firsts <= before + limit))

    def _append_link(self, track: LinkTrack, stamps_ns: IntArray, row_end_by_tick: IntArray) -> None:
        """Count the frames of each tick, at the stamp of its last frame."""
        starts = np.concatenate([[0], row_end_by_tick[:-1]])
        has_frames = row_end_by_tick > starts
        ends = row_end_by_tick[has_frames]
        lost = np.add.reduceat(track.lost, starts[has_frames])
        self._link.append(stamps_ns[ends - 1], np.cumsum(has_frames), received=ends - starts[has_frames], lost=lost)

    def _detect_silence(self, stamps_ns: IntArray, row_end_by_tick: IntArray | None) -> None:
        """Detect the end of a silence of the whole link, from where heartbeats are missed again."""
        first_ns = int(stamps_ns[0])
        if (
            (row_end_by_tick is None or len(row_end_by_tick) == 1)  # ``has_no_silence`` over several
            and self._newest_ns is not None
            and first_ns > self._newest_ns + self._settings.heartbeat_ns
        ):
            self._resumed.append(stamps_ns[:1])
        lasts = stamps_ns[-1:] if row_end_by_tick is None else stamps_ns[row_end_by_tick[row_end_by_tick > 0] - 1]
        self._newest_ns = max(int(lasts.max()), self._newest_ns or 0)

    def at(self, stamp_ns: int) -> Health:
        """Health as of a stamp, from nothing later."""
        gps, estimator = _last(self._gps, stamp_ns), _last(self._estimator, stamp_ns)
        fresh = estimator is not None and estimator.age_ns <= self._settings.heartbeat_ns
        fix = None if gps is None else int(self._gps.column("fix")[gps.row])
        ratios = self._estimator.column("ratios")[estimator.row].tolist() if fresh and estimator else ()
        received, lost = self._link_counts(stamp_ns)
        silences = [_age_s(stream, stamp_ns) for stream in (self._heartbeat, self._resumed)]
        return Health(
            heartbeat_age_s=None if silences[0] is None else min(age for age in silences if age is not None),
            gps_fix=fix,
            gps_age_s=None if gps is None else gps.age_ns / SECOND_NS,
            satellites=None if gps is None else _count_or_none(self._gps.column("satellites")[gps.row]),
            horizontal_std_m=None if gps is None else _none_if_nan(self._gps.column("horizontal_std_m")[gps.row]),
            vertical_std_m=None if gps is None else _none_if_nan(self._gps.column("vertical_std_m")[gps.row]),
            ratios=dict(zip(RATIOS, ratios, strict=False)),
            has_attitude=bool(self._estimator.column("has_attitude")[estimator.row]) if fresh and estimator else None,
            received=received,
            lost=lost,
            ages_s={name: age for name, each in self._kinds.items() if (age := _age_s(each, stamp_ns)) is not None},
        )

    def with_verdicts(self, poses: PoseBatch, ticks: IntArray) -> PoseBatch:
        """Poses with status, reasons, standard deviation and origin by the health as of ticks ``(n,)``."""
        return _with_verdicts(poses, *self._verdicts(poses.stamp_ns, ticks))

    def _verdicts(self, stamps_ns: IntArray, ticks: IntArray) -> tuple[list[_Verdict], IntArray]:
        """Verdicts, and the index ``(n,)`` of each pose's at stamps ``(n,)``, as of ticks ``(n,)``.

        Facts change a few times a second at most: the rules are applied once per change.
        """
        columns = (*self._rows_and_flags(stamps_ns, ticks), self._lost_shares(stamps_ns, ticks))
        failures, rivals = self._failures.before_each(stamps_ns, ticks), self._rivals.before_each(stamps_ns, ticks)
        is_new = np.ones(len(stamps_ns), dtype=np.bool_)  # than that of the stamp before
        if not any(failures) and not any(rivals):
            is_new[1:] = np.any([column[1:] != column[:-1] for column in columns], axis=0)
        rows = np.flatnonzero(is_new).tolist()
        facts = zip(*(column[rows].tolist() for column in columns), strict=True)
        keys = [(_FactRows(*values), failures[row], rivals[row]) for values, row in zip(facts, rows, strict=True)]
        verdicts = {key: _verdict_on(self._facts(*key), self._settings) for key in keys}
        return [verdicts[key] for key in keys], np.cumsum(is_new) - 1

    def _rows_and_flags(self, stamps_ns: IntArray, ticks: IntArray) -> tuple[IntArray | BoolArray, ...]:
        """Whether the autopilot is silent; newest rows of EKF and GPS, and whether these are late."""
        limits = self._settings
        heartbeat, resumed = (_ages_ns(stream, stamps_ns, ticks) for stream in (self._heartbeat, self._resumed))
        silent = (heartbeat != _NEVER) & (np.minimum(heartbeat, resumed) > limits.heartbeat_ns)
        estimator, gps = (stream.last_before(stamps_ns, ticks) for stream in (self._estimator, self._gps))
        estimator_ns, gps_ns = (_ages_ns(stream, stamps_ns, ticks) for stream in (self._estimator, self._gps))
        is_late = (estimator >= 0) & (estimator_ns > limits.heartbeat_ns), (gps >= 0) & (gps_ns > limits.gps_ns)
        return silent, self._remarkable_rows(estimator), is_late[0], self._first_of_equal(gps), is_late[1]

    def _remarkable_rows(self, rows: IntArray) -> IntArray:
        """EKF rows ``(n,)``, with -1 also for rows from which nothing follows."""
        if len(rows) <= 1 or self._estimator.is_empty:
            return rows
        ratios, has_attitude = (self._estimator.column(name)[rows] for name in ("ratios", "has_attitude"))
        return np.where(_is_unremarkable(ratios, has_attitude, self._settings), -1, rows)

    def _first_of_equal(self, rows: IntArray) -> IntArray:
        """GPS rows ``(n,)``, replaced by the first of consecutive rows with equal values."""
        if len(rows) <= 1 or self._gps.is_empty:
            return rows
        columns = [self._gps.column(name)[rows] for name in ("fix", "horizontal_std_m", "vertical_std_m")]
        has_changed = np.any(np.diff(np.nan_to_num([*columns, rows < 0])) != 0, axis=0)
        first = np.where(np.concatenate([[True], has_changed]), np.arange(len(rows)), 0)
        return np.asarray(rows[np.maximum.accumulate(first)])

    def _facts(self, row: "_FactRows", failures: tuple[str, ...], rivals: tuple[str, ...]) -> _Facts:
        estimator, gps = row.estimator, row.gps
        has_estimator, has_gps = estimator >= 0 and not row.is_estimator_silent, gps >= 0
        of_gps, of_estimator = self._gps.column, self._estimator.column
        return _Facts(
            is_silent=row.is_silent,
            has_attitude=bool(of_estimator("has_attitude")[estimator]) if has_estimator else None,
            ratios=tuple(zip(RATIOS, of_estimator("ratios")[estimator].tolist(), strict=True)) if has_estimator else (),
            is_estimator_silent=row.is_estimator_silent,
            gps_fix=int(of_gps("fix")[gps]) if has_gps else None,
            is_gps_silent=row.is_gps_silent,
            horizontal_std_m=_none_if_nan(of_gps("horizontal_std_m")[gps]) if has_gps else None,
            vertical_std_m=_none_if_nan(of_gps("vertical_std_m")[gps]) if has_gps else None,
            lost_share=row.lost_share,
            failures=failures,
            rivals=rivals,
        )

    def _lost_shares(self, stamps_ns: IntArray, ticks: IntArray) -> FloatArray:
        """Lost fractions ``(n,)`` of the autopilot's frames over the window before stamps; 0 below the limit."""
        link, shares = self._link, np.zeros(len(stamps_ns))
        if link.is_empty:
            return shares
        first, _ = link.rows_known_at(ticks)
        ends = [np.maximum(link.last_before(stamps_ns - ago_ns, ticks) + 1, first) for ago_ns in (0, self._window_ns)]
        lost, received = (np.concatenate([[0], np.cumsum(link.column(name))]) for name in ("lost", "received"))
        lost_in_window, received_in_window = (counts[ends[0]] - counts[ends[1]] for counts in (lost, received))
        has_lost = lost_in_window > 0
        shares[has_lost] = lost_in_window[has_lost] / (lost_in_window[has_lost] + received_in_window[has_lost])
        return np.where(shares > self._settings.loss_share, shares, 0.0)

    def _link_counts(self, stamp_ns: int) -> tuple[int, int]:
        """Numbers of frames received and lost over the window before a stamp."""
        if not len(self._link.stamps_ns):
            return 0, 0
        ends = [stamp_ns - self._settings.window_ns, stamp_ns]
        rows = slice(*np.searchsorted(self._link.stamps_ns, ends, side="right").tolist())
        return int(self._link.column("received")[rows].sum()), int(self._link.column("lost")[rows].sum())


class _FactRows(NamedTuple):
    """Rows (-1 for none) and flags that a verdict follows from."""

    is_silent: bool
    estimator: int
    is_estimator_silent: bool
    gps: int
    is_gps_silent: bool
    lost_share: float


@dataclass(frozen=True, slots=True)
class _LastSample:
    row: int
    age_ns: int


def _last(stream: Stream, stamp_ns: int) -> _LastSample | None:
    """The newest row that is not after a stamp, with its age; None if there is none."""
    stamps = stream.stamps_ns
    row = int(np.searchsorted(stamps, stamp_ns, side="right")) - 1
    return None if row < 0 else _LastSample(row, stamp_ns - int(stamps[row]))


def _age_s(stream: Stream, stamp_ns: int) -> float | None:
    last = _last(stream, stamp_ns)
    return None if last is None else last.age_ns / SECOND_NS


def _ages_ns(stream: Stream, stamps_ns: IntArray, ticks: IntArray) -> IntArray:
    """Ages ``(n,)`` of the newest rows that are not after stamps; ``_NEVER`` where there is none."""
    rows = stream.last_before(stamps_ns, ticks)
    if stream.is_empty:
        return np.full(len(stamps_ns), _NEVER)
    return np.where(rows >= 0, stamps_ns - stream.stamps_ns[rows], _NEVER)


def _name(track: Track) -> str:
    if isinstance(track, GimbalTrack | HeightTrack | CameraTrack | TriggerTrack):
        return str(track.source)
    return _TRACK_NAMES.get(type(track), type(track).__name__)


def _count_or_none(count: float) -> int | None:
    return int(count) if count >= 0 else None


def _none_if_nan(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
