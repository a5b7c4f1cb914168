"""What a vehicle says of itself, and what was known of that at a stamp."""

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
    ClockTrack,
    EstimatorTrack,
    FloatArray,
    GimbalFailureTrack,
    GimbalSource,
    GimbalTrack,
    GpsTrack,
    Health,
    HeartbeatTrack,
    HeightTrack,
    IntArray,
    LinkTrack,
    PoseBatch,
    PoseSample,
    PositionTrack,
    RivalTrack,
    Status,
    Track,
    VehicleTrack,
)
from aerodft.service.settings import HealthSettings
from aerodft.service.streams import Stream

_WARNING_SHARE: Final = 0.8  # of the largest ratio
_OF_THE_GIMBAL: Final = (GimbalSource.MOUNT_ORIENTATION, GimbalSource.MOUNT_STATUS)  # that cannot say so themselves


class _Facts(NamedTuple):
    """What a verdict follows from; None for what was never said.

    Attributes:
        is_silent: Whether the autopilot's HEARTBEAT stays away.
        has_attitude: Whether the estimator has an attitude.
        ratios: The estimator's test ratios, by what they are of.
        is_estimator_silent: Whether it said something once, and nothing believable since.
        gps_fix: GPS_FIX_TYPE.
        is_gps_silent: Whether the receiver spoke once, and stays away.
        horizontal_std_m: Of its position.
        vertical_std_m: Of its altitude.
        lost_share: Share of the autopilot's frames, where that is more than may be lost; else 0.
        failures: What the gimbal said that it failed in, lately.
        rivals: Who else spoke, lately.
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
    """What a vehicle's health means for a pose, as long as the facts stay what they are.

    Attributes:
        status: Of poses with faults.
        faults: Why there can be no answer, in sentences.
        remarks: What makes an answer worth less, in sentences.
        failures: As in ``_Facts``.
        rivals: As in ``_Facts``.
        horizontal_std_m: The least that a place may have.
        has_place: Whether the receiver knows where it is.
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
        """Whether there is nothing to say of a pose, but for the least std of its place."""
        return self.has_place and not (self.faults or self.remarks or self.failures or self.rivals)

    def refuses(self, sample: PoseSample) -> bool:
        """Whether a pose that is ok gets no answer: by a fault, or by what its own gimbal failed in."""
        return bool(self.faults) or (bool(self.failures) and sample.attitude_source in _OF_THE_GIMBAL)

    def applied(self, sample: PoseSample) -> PoseSample:
        """A sample without its numbers, with the status, the reasons and the origin that follow."""
        if sample.status is not Status.OK:
            said = (*self.faults, *self.failures, *self.rivals)
            return replace(sample, reasons=(*sample.reasons, *said))
        if self.refuses(sample):
            not_believed = tuple(f"{each}: its other reports are not believed" for each in self.failures)
            status = self.status if self.faults else Status.UNHEALTHY
            return replace(sample, status=status, reasons=(*(self.faults or not_believed), *sample.reasons))
        remarks = (*self.remarks, *self.failures, *self.rivals)
        origin = sample.origin if self.has_place else None
        return replace(sample, origin=origin, reasons=(*sample.reasons, *remarks))


def _with_verdicts(poses: PoseBatch, verdicts: Sequence[_Verdict], verdict_index: IntArray) -> PoseBatch:
    """Poses ``(n,)``, each with the verdict of its index ``(n,)``."""
    refused = [[verdict.refuses(variant) for verdict in verdicts] for variant in poses.variants]
    is_refused = np.array(refused, dtype=np.bool_)[poses.variant_index, verdict_index]
    stays = (poses.status == CODE_OF[Status.OK]) & ~is_refused
    least_m = np.array([verdict.horizontal_std_m for verdict in verdicts])[verdict_index]
    has_place = np.array([verdict.has_place for verdict in verdicts], dtype=np.bool_)[verdict_index]
    widened = _with_horizontal_std(poses, stays & poses.has_pose & (least_m > poses.std[:, HORIZONTAL]), least_m)
    placed = replace(widened, lat_lon_alt=np.where((stays & ~has_place)[:, None], np.nan, widened.lat_lon_alt))
    keys = [None if verdict.is_silent else verdict for verdict in verdicts]
    return placed.with_variants(
        [keys[k] for k in verdict_index.tolist()], lambda sample, verdict: verdict.applied(sample)
    )


def _verdict_on(facts: _Facts, limits: HealthSettings) -> _Verdict:
    """What the rules make of facts."""
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


def _is_calm(ratios: FloatArray, has_attitude: FloatArray, limits: HealthSettings) -> BoolArray:
    """Where nothing follows from what estimators said: test ratios ``(n, k)``, and whether there is an attitude."""
    return np.asarray((has_attitude != 0) & ~np.any(ratios >= _WARNING_SHARE * limits.max_ratio, axis=1))


def _faults(facts: _Facts, limits: HealthSettings) -> tuple[Status, list[str]]:
    """Why there can be no answer, in sentences; and the status of that."""
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
    """What makes an answer worth less, in sentences."""
    remarks = []
    if facts.gps_fix is not None and facts.gps_fix < FIX_3D:
        remarks.append(f"GPS has no 3D fix (fix type {facts.gps_fix}): the place is not known")
    if facts.is_gps_silent:
        remarks.append(f"GPS has been silent for more than {limits.gps_ns / SECOND_NS:g} s")
    for what, std_m, most_m in (
        ("horizontally", facts.horizontal_std_m, limits.horizontal_std_m),
        ("vertically", facts.vertical_std_m, limits.vertical_std_m),
    ):
        if std_m is not None and std_m > most_m:
            remarks.append(f"GPS is accurate to {std_m:.1f} m {what} only, at best {most_m:g} m is wanted")
    if facts.is_estimator_silent:
        most_s = limits.heartbeat_ns / SECOND_NS
        remarks.append(f"the autopilot's estimator has said nothing believable for more than {most_s:g} s")
    remarks += [
        f"the autopilot's estimator is near its limit: its test ratio of {name} is {ratio:.2f}"
        for name, ratio in facts.ratios
        if ratio >= _WARNING_SHARE * limits.max_ratio
    ]
    if facts.lost_share:
        share, seconds = round(100 * facts.lost_share), limits.window_ns / SECOND_NS
        remarks.append(f"the link lost {share} % of the autopilot's frames over {seconds:g} s")
    return remarks


def _with_horizontal_std(poses: PoseBatch, rows: BoolArray, least_m: FloatArray) -> PoseBatch:
    """Poses of which those of some rows ``(n,)`` have standard deviations ``least_m (n,)`` of their place."""
    at = np.flatnonzero(rows)
    if not len(at):
        return poses
    before, std = poses.std[at], poses.std.copy()
    std[at, HORIZONTAL] = least_m[at]
    wxyz, cov = poses.pose.wxyz[at], poses.pose.cov.copy()
    cov[at] += pose_covariance(wxyz, std[at]) - pose_covariance(wxyz, before)
    return replace(poses, std=std, pose=replace(poses.pose, cov=cov))


_LOG: Final = logging.getLogger(__name__)


class _RecentWarnings:
    """Sentences, each at once in the log when it is first heard, and of every stamp up to ``window_ns`` later."""

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._streams: dict[str, Stream] = {}

    def streams(self) -> tuple[Stream, ...]:
        """All streams."""
        return tuple(self._streams.values())

    def append(self, what: str, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Take in when a sentence held, as ``Stream.append``."""
        if what not in self._streams:
            _LOG.warning("%s", what)
            self._streams[what] = Stream(self._window_ns)
        self._streams[what].append(stamps_ns, row_end_by_tick)

    def before_each(self, stamps_ns: IntArray, ticks: IntArray) -> list[tuple[str, ...]]:
        """What was heard in the time before each of the stamps ``(n,)``, as of ticks ``(n,)``."""
        found: list[tuple[str, ...]] = [()] * len(stamps_ns)
        for what, each in self._streams.items():
            rows = each.last_before(stamps_ns, ticks)
            for k in np.flatnonzero(rows >= 0).tolist():
                if stamps_ns[k] - each.stamps_ns[rows[k]] <= self._window_ns:
                    found[k] = (*found[k], what)
        return found


_GIMBAL_NS: Final = SECOND_NS  # for which a failure that its gimbal reports counts
_NEVER: Final = np.iinfo(np.int64).max
_NAMES: Final = {
    ClockTrack: "clock",
    VehicleTrack: "vehicle attitude",
    PositionTrack: "position",
    HeartbeatTrack: "heartbeat",
    GpsTrack: "gps",
    EstimatorTrack: "estimator",
}


class HealthSources:
    """All that a vehicle says of itself, and when anything of a kind came last."""

    def __init__(self, settings: HealthSettings) -> None:
        self._settings = settings
        self._window_ns = settings.window_ns
        self._kinds: dict[str, Stream] = {}
        self._heartbeat, self._gps = Stream(settings.heartbeat_ns), Stream(settings.gps_ns)
        self._estimator, self._link = Stream(settings.heartbeat_ns), Stream(settings.window_ns)
        self._resumed = Stream(settings.heartbeat_ns)  # when all had been silent before
        self._rivals, self._failures = _RecentWarnings(settings.window_ns), _RecentWarnings(_GIMBAL_NS)
        self._newest_ns: int | None = None

    def streams(self) -> tuple[Stream, ...]:
        """All streams, to be forgotten or moved when clocks jump."""
        own = (self._heartbeat, self._gps, self._estimator, self._link, self._resumed)
        return (*own, *self._rivals.streams(), *self._failures.streams(), *self._kinds.values())

    def append(self, track: Track, stamps_ns: IntArray, row_end_by_tick: IntArray | None = None) -> None:
        """Take a track of a step in, whatever it is of; as ``Stream.append``."""
        if isinstance(track, RivalTrack | GimbalFailureTrack):
            warnings = self._rivals if isinstance(track, RivalTrack) else self._failures
            warnings.append(track.what, stamps_ns, row_end_by_tick)
            return
        if len(stamps_ns):
            self._note_silence(stamps_ns, row_end_by_tick)
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
        """Whether a track of several ticks may be appended at once: its kind is known, since clocks were set."""
        if isinstance(track, LinkTrack):
            return True
        return _name(track) in self._kinds and not self._kinds[_name(track)].is_empty

    def goes_on(self, stamps: Sequence[IntArray], row_ends: Sequence[IntArray]) -> bool:
        """Whether there is no silence in or before tracks of several ticks: their stamps ``(n,)`` and rows by tick."""
        newest, limit = self._newest_ns, self._settings.heartbeat_ns
        if newest is None:
            return False
        ticks = len(row_ends[0])
        firsts, lasts = np.full(ticks, newest), np.full(ticks, newest)
        for stamps_ns, ends in zip(stamps, row_ends, strict=True):
            starts = np.concatenate([[0], ends[:-1]])
            came = np.flatnonzero(ends > starts)
            firsts[came] = np.maximum(firsts[came], stamps_ns[starts[came]])
            lasts[came] = np.maximum(lasts[came], stamps_ns[ends[came] - 1])
        before = np.concatenate([[newest], np.maximum.accumulate(lasts)[:-1]])
        return bool(np.all(firsts <= before + limit))

    def _append_link(self, track: LinkTrack, stamps_ns: IntArray, row_end_by_tick: IntArray) -> None:
        """Count the frames of each tick, at its last one's stamp."""
        starts = np.concatenate([[0], row_end_by_tick[:-1]])
        came = row_end_by_tick > starts
        ends = row_end_by_tick[came]
        lost = np.add.reduceat(track.lost, starts[came])
        self._link.append(stamps_ns[ends - 1], np.cumsum(came), received=ends - starts[came], lost=lost)

    def _note_silence(self, stamps_ns: IntArray, row_end_by_tick: IntArray | None) -> None:
        """A link that was dead, or a clock that was set, is no autopilot without heartbeat: that counts from there."""
        first_ns = int(stamps_ns[0])
        if (
            (row_end_by_tick is None or len(row_end_by_tick) == 1)  # ``goes_on`` over several
            and self._newest_ns is not None
            and first_ns > self._newest_ns + self._settings.heartbeat_ns
        ):
            self._resumed.append(stamps_ns[:1])
        lasts = stamps_ns[-1:] if row_end_by_tick is None else stamps_ns[row_end_by_tick[row_end_by_tick > 0] - 1]
        self._newest_ns = max(int(lasts.max()), self._newest_ns or 0)

    def at(self, stamp_ns: int) -> Health:
        """What was known at a stamp: nothing later than it."""
        gps, estimator = _last(self._gps, stamp_ns), _last(self._estimator, stamp_ns)
        fresh = estimator is not None and estimator.age_ns <= self._settings.heartbeat_ns
        fix = None if gps is None else int(self._gps.column("fix")[gps.row])
        ratios = self._estimator.column("ratios")[estimator.row].tolist() if fresh and estimator else ()
        received, lost = self._link_counts(stamp_ns)
        silent = [_age_s(stream, stamp_ns) for stream in (self._heartbeat, self._resumed)]
        return Health(
            heartbeat_age_s=None if silent[0] is None else min(age for age in silent if age is not None),
            gps_fix=fix,
            gps_age_s=None if gps is None else gps.age_ns / SECOND_NS,
            satellites=None if gps is None else _known(self._gps.column("satellites")[gps.row]),
            horizontal_std_m=None if gps is None else _finite(self._gps.column("horizontal_std_m")[gps.row]),
            vertical_std_m=None if gps is None else _finite(self._gps.column("vertical_std_m")[gps.row]),
            ratios=dict(zip(RATIOS, ratios, strict=False)),
            has_attitude=bool(self._estimator.column("has_attitude")[estimator.row]) if fresh and estimator else None,
            received=received,
            lost=lost,
            ages_s={name: age for name, each in self._kinds.items() if (age := _age_s(each, stamp_ns)) is not None},
        )

    def judged(self, poses: PoseBatch, ticks: IntArray) -> PoseBatch:
        """Poses with what follows for them, each as of a tick ``(n,)``: a status, a wider std, no place, remarks."""
        return _with_verdicts(poses, *self._verdicts(poses.stamp_ns, ticks))

    def _verdicts(self, stamps_ns: IntArray, ticks: IntArray) -> tuple[list[_Verdict], IntArray]:
        """Verdicts on poses at stamps ``(n,)``, each as of a tick ``(n,)``; and which of them each pose has, ``(n,)``.

        Facts change a few times a second at most: the rules are gone through once for each of them.
        """
        columns = (*self._rows_and_flags(stamps_ns, ticks), self._lost_shares(stamps_ns, ticks))
        failures, rivals = self._failures.before_each(stamps_ns, ticks), self._rivals.before_each(stamps_ns, ticks)
        is_other = np.ones(len(stamps_ns), dtype=np.bool_)  # than that of the stamp before
        if not any(failures) and not any(rivals):
            is_other[1:] = np.any([column[1:] != column[:-1] for column in columns], axis=0)
        rows = np.flatnonzero(is_other).tolist()
        facts = zip(*(column[rows].tolist() for column in columns), strict=True)
        keys = [(_Row(*values), failures[row], rivals[row]) for values, row in zip(facts, rows, strict=True)]
        verdicts = {key: _verdict_on(self._facts(*key), self._settings) for key in keys}
        return [verdicts[key] for key in keys], np.cumsum(is_other) - 1

    def _rows_and_flags(self, stamps_ns: IntArray, ticks: IntArray) -> tuple[IntArray | BoolArray, ...]:
        """Whether the autopilot is silent; the newest rows of the estimator and of GPS, and whether these are late."""
        limits = self._settings
        beat, resumed = (_ages_ns(stream, stamps_ns, ticks) for stream in (self._heartbeat, self._resumed))
        silent = (beat != _NEVER) & (np.minimum(beat, resumed) > limits.heartbeat_ns)
        estimator, gps = (stream.last_before(stamps_ns, ticks) for stream in (self._estimator, self._gps))
        estimator_ns, gps_ns = (_ages_ns(stream, stamps_ns, ticks) for stream in (self._estimator, self._gps))
        late = (estimator >= 0) & (estimator_ns > limits.heartbeat_ns), (gps >= 0) & (gps_ns > limits.gps_ns)
        return silent, self._telling(estimator), late[0], self._first_alike(gps), late[1]

    def _telling(self, rows: IntArray) -> IntArray:
        """Rows of the estimator ``(n,)``, -1 also for those that nothing follows from."""
        if len(rows) <= 1 or self._estimator.is_empty:
            return rows
        ratios, has_attitude = (self._estimator.column(name)[rows] for name in ("ratios", "has_attitude"))
        return np.where(_is_calm(ratios, has_attitude, self._settings), -1, rows)

    def _first_alike(self, rows: IntArray) -> IntArray:
        """Rows of GPS ``(n,)``, of those one after the other that say the same the first."""
        if len(rows) <= 1 or self._gps.is_empty:
            return rows
        said = [self._gps.column(name)[rows] for name in ("fix", "horizontal_std_m", "vertical_std_m")]
        is_other = np.any(np.diff(np.nan_to_num([*said, rows < 0])) != 0, axis=0)
        first = np.where(np.concatenate([[True], is_other]), np.arange(len(rows)), 0)
        return np.asarray(rows[np.maximum.accumulate(first)])

    def _facts(self, row: "_Row", failures: tuple[str, ...], rivals: tuple[str, ...]) -> _Facts:
        estimator, gps = row.estimator, row.gps
        speaks, knows = estimator >= 0 and not row.is_estimator_silent, gps >= 0
        of_gps, of_estimator = self._gps.column, self._estimator.column
        return _Facts(
            is_silent=row.is_silent,
            has_attitude=bool(of_estimator("has_attitude")[estimator]) if speaks else None,
            ratios=tuple(zip(RATIOS, of_estimator("ratios")[estimator].tolist(), strict=True)) if speaks else (),
            is_estimator_silent=row.is_estimator_silent,
            gps_fix=int(of_gps("fix")[gps]) if knows else None,
            is_gps_silent=row.is_gps_silent,
            horizontal_std_m=_finite(of_gps("horizontal_std_m")[gps]) if knows else None,
            vertical_std_m=_finite(of_gps("vertical_std_m")[gps]) if knows else None,
            lost_share=row.lost_share,
            failures=failures,
            rivals=rivals,
        )

    def _lost_shares(self, stamps_ns: IntArray, ticks: IntArray) -> FloatArray:
        """Shares ``(n,)`` of the autopilot's frames that were lost over the window before stamps; 0 where few were."""
        link, shares = self._link, np.zeros(len(stamps_ns))
        if link.is_empty:
            return shares
        first, _ = link.rows_known_at(ticks)
        ends = [np.maximum(link.last_before(stamps_ns - ago_ns, ticks) + 1, first) for ago_ns in (0, self._window_ns)]
        lost, received = (np.concatenate([[0], np.cumsum(link.column(name))]) for name in ("lost", "received"))
        gone, came = (counts[ends[0]] - counts[ends[1]] for counts in (lost, received))
        some = gone > 0
        shares[some] = gone[some] / (gone[some] + came[some])
        return np.where(shares > self._settings.loss_share, shares, 0.0)

    def _link_counts(self, stamp_ns: int) -> tuple[int, int]:
        """Frames received and lost over the window before a stamp."""
        if not len(self._link.stamps_ns):
            return 0, 0
        ends = [stamp_ns - self._settings.window_ns, stamp_ns]
        rows = slice(*np.searchsorted(self._link.stamps_ns, ends, side="right").tolist())
        return int(self._link.column("received")[rows].sum()), int(self._link.column("lost")[rows].sum())


class _Row(NamedTuple):
    """Rows that a verdict follows from, -1 for none, and what time makes of them."""

    is_silent: bool
    estimator: int
    is_estimator_silent: bool
    gps: int
    is_gps_silent: bool
    lost_share: float


@dataclass(frozen=True, slots=True)
class _Newest:
    row: int
    age_ns: int


def _last(stream: Stream, stamp_ns: int) -> _Newest | None:
    """The newest row that is not after a stamp."""
    stamps = stream.stamps_ns
    row = int(np.searchsorted(stamps, stamp_ns, side="right")) - 1
    return None if row < 0 else _Newest(row, stamp_ns - int(stamps[row]))


def _age_s(stream: Stream, stamp_ns: int) -> float | None:
    last = _last(stream, stamp_ns)
    return None if last is None else last.age_ns / SECOND_NS


def _ages_ns(stream: Stream, stamps_ns: IntArray, ticks: IntArray) -> IntArray:
    """Since the newest rows that are not after stamps ``(n,)``; the longest of times where there is none."""
    rows = stream.last_before(stamps_ns, ticks)
    if stream.is_empty:
        return np.full(len(stamps_ns), _NEVER)
    return np.where(rows >= 0, stamps_ns - stream.stamps_ns[rows], _NEVER)


def _name(track: Track) -> str:
    if isinstance(track, GimbalTrack | HeightTrack | CameraTrack):
        return str(track.source)
    return _NAMES.get(type(track), type(track).__name__)


def _known(count: float) -> int | None:
    return int(count) if count >= 0 else None


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
