"""Photos matched to a log's trigger messages by order and intervals, with the offset of the camera's clock.

Photos and triggers are two ordered lists of which either may lack entries. Every alignment that keeps their order has a
likelihood: stamps cut to the camera's resolution, a clock with an offset and a drift, photos lost, photos without a
trigger. Forward-backward sums (Rabiner 1989) over all alignments, and over all offsets that explain the intervals, give
the probability that a photo belongs to a trigger. A photo without a certain trigger is refused.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from aerodft.jit import njit
from aerodft.model import BoolArray, FloatArray, IntArray

MIN_PROBABILITY: Final = 0.9995
"""Smallest probability of an accepted match: of 43,700 simulated photos one is wrong above 0.999, none above 0.9995."""

_MIN_MATCHES: Final = 5  # fewer intervals may agree by chance
_LOST, _LOST_AT_END = 0.03, 0.3  # probability that a trigger has no photo; cameras start late and stop early
_EXTRA, _EXTRA_AT_END = 0.01, 0.1  # expected photos without a trigger, of all
_DOUBLED_S: Final = 0.4  # no camera here takes two photos within: a second message of one trigger
_DOUBLED_SHARE: Final = 0.4  # of the median interval, where that is shorter
_DRIFT_STD: Final = 1e-4  # of cameras' clocks: 9 s a day; half lets intervals tell less, twice lets noise tilt the line
_JITTER_S: Final = 0.1  # of shutters behind their trigger, to begin with
_MIN_JITTER_S: Final = 0.03
# Stamps of regular triggers are cut at few phases: a fit of their jitter then is too good, and 6 of 43,600 photos were
# given the trigger before or after with 0.03; half leaves 2.
_ALLOWED_JITTER_S: Final = 0.1
_CUT_SHARE: Final = 0.2  # of half a stamp's resolution: below, jitter cannot be told from how stamps are cut
_MAX_JITTER_S: Final = (
    0.2  # an alignment that needs more is none; with 0.5 a tenth of the photos of other flights fitted
)
_CANDIDATES: Final = 12  # offsets that are compared in full
# Starts on either side of the best offset, over two resolutions: intervals near the resolution have a local best at
# each multiple, and votes for the true one may fall between two of them (a flight at 1.0 s was one trigger off).
_PHASES: Final = 8
_MOST_VOTES: Final = 600  # photos that vote for offsets
_ROUGH_ITERATIONS, _ITERATIONS = 2, 4
_ROUGH_NATS: Final = 200.0  # below the best after the rough ones: a drift that is not fitted yet costs no more
_REACH: Final = 6.0  # standard deviations at which a match is impossible
_IMPOSSIBLE: Final = -1e300
_NEGLIGIBLE: Final = 40.0  # nats: 4e-18, below a double's digits
_MIN_SHARE: Final = 0.7  # of the photos or the triggers, whichever are fewer
# Nats a match: of 100 simulated flights at least 3.8, of photos of another flight 2 of 100 more than 3.6.
_MIN_EVIDENCE: Final = 3.6
_GRID: Final = 161
# Probability, at each photo, that the camera's clock is set: a thirtieth of that of a lost photo, so that one does not
# hide it. Half as much leaves photos of some more stepped flights wrong; twice refuses 2 % more of all others.
_STEP: Final = 0.001
# Clocks are set by hand or by GPS, by a second and more. Smaller steps would explain stamps that are cut at two phases.
_LEAST_STEP_S, _MOST_STEP_S = 0.75, 6.0
_MOST_STEPS: Final = 2  # in one flight
_STEP_EVIDENCE: Final = 3.0  # nats above one clock from which on a step is taken for one; below, both are weighed
_LIKELY_SWITCH: Final = 1e-4  # probability of a place of a step, above which photos beside it are left out
_UNTOLD: Final = "the intervals do not tell which photo belongs to which trigger"
_NEGLIGIBLE_WEIGHT: Final = 1e-6  # of a hypothesis, by which no match is decided
_MOSTLY: Final = 0.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PhotoMatches:
    """Triggers of photos, and the camera's clock: ``utc = stamp + offset + drift (stamp - reference)``.

    Attributes:
        trigger: ``(p,)`` index of each photo's trigger; -1 where none is certain.
        probability: ``(p,)`` of the likeliest trigger.
        offset_s: UTC minus the camera's stamp at the reference; NaN where nothing matches.
        offset_std_s: Its standard deviation.
        drift: Growth of the offset per second of the camera's clock.
        drift_std: Its standard deviation.
        reference_s: The photos' mean stamp.
        doubled: ``(t,)`` triggers that are a second message of the one before.
        lost: ``(t,)`` triggers that certainly have no photo, between the first and the last matched one.
        steps: Photos near which the camera's clock was set in mid-flight; the clock then is that of most photos.
        why: Sentence on why no photo is matched; empty where some are.
    """

    trigger: IntArray
    probability: FloatArray
    offset_s: float
    offset_std_s: float
    drift: float
    drift_std: float
    reference_s: float
    doubled: BoolArray
    lost: BoolArray
    steps: tuple[int, ...] = ()
    why: str = ""


def match_photos(
    photo_s: FloatArray,
    trigger_s: FloatArray,
    *,
    resolution_s: float,
    is_ordered: BoolArray | None = None,
    clock_std_s: float = 3600.0,
) -> PhotoMatches:
    """Match photos to triggers.

    Args:
        photo_s: ``(p,)`` stamps by the camera's clock, ascending, cut to its resolution.
        trigger_s: ``(t,)`` UTC of the triggers, ascending; both in seconds since a common epoch.
        resolution_s: What stamps are cut to: 1 s for EXIF dates without fractions.
        is_ordered: ``(p,)`` whether a photo's place among others of one stamp is known; None for all.
        clock_std_s: Prior standard deviation of the camera's clock.
    """
    doubled = _doubled(trigger_s)
    kept = np.flatnonzero(~doubled)
    times_s = trigger_s[kept]
    if min(len(photo_s), len(times_s)) < _MIN_MATCHES:
        return _nothing(len(photo_s), doubled, f"{len(photo_s)} photos and {len(times_s)} triggers are too few to tell")
    ordered = np.ones(len(photo_s), dtype=np.bool_) if is_ordered is None else is_ordered
    found = _search(photo_s, times_s, ordered, resolution_s, clock_std_s, _MOST_STEPS)
    if found.clock is None or np.count_nonzero(found.certain) < _MIN_MATCHES:
        return replace(_nothing(len(photo_s), doubled, found.why or _UNTOLD, found.probability), steps=found.steps)
    trigger = np.where(found.certain, kept[found.choice], -1)
    offset_s, offset_std_s, drift, drift_std = found.clock.posterior_clock()
    matched = np.zeros(len(trigger_s), dtype=np.bool_)
    matched[trigger[found.certain]] = True
    inner = np.zeros(len(trigger_s), dtype=np.bool_)
    inner[trigger[found.certain].min() : trigger[found.certain].max() + 1] = True
    unexplained = np.zeros(len(trigger_s), dtype=np.bool_)
    unexplained[kept] = found.explained < 1 - MIN_PROBABILITY
    return PhotoMatches(
        trigger=trigger,
        probability=found.probability,
        offset_s=offset_s,
        offset_std_s=offset_std_s,
        drift=drift,
        drift_std=drift_std,
        reference_s=found.clock.reference_s,
        doubled=doubled,
        lost=inner & ~matched & unexplained,
        steps=found.steps,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Found:
    """Matches of some photos ``(p,)`` to triggers ``(t,)``.

    ``choice``, ``probability`` and ``certain`` are of the photos, ``explained`` is the probability that a trigger has a
    photo; ``clock`` is that of most matched photos, ``steps`` are photos from which on it was set.
    """

    choice: IntArray
    probability: FloatArray
    certain: BoolArray
    explained: FloatArray
    clock: "_Clock | None"
    steps: tuple[int, ...] = ()
    why: str = ""


def _search(
    photo_s: FloatArray,
    times_s: FloatArray,
    is_ordered: BoolArray,
    resolution_s: float,
    clock_std_s: float,
    most_steps: int,
) -> _Found:
    """Match photos by one clock of the camera, or by one before and one behind each time that it was set."""
    none = np.zeros(len(photo_s), dtype=np.int64)
    nothing = _Found(
        choice=none,
        probability=np.zeros(len(photo_s)),
        certain=none > 0,
        explained=np.zeros(len(times_s)),
        clock=None,
        why=_UNTOLD,
    )
    if min(len(photo_s), len(times_s)) < _MIN_MATCHES:
        return nothing
    clocks = _Alignments(photo_s, times_s, resolution_s, clock_std_s).best()
    if not clocks:
        return replace(nothing, why="no offset of the camera's clock explains the intervals")
    stepped = [each for clock in clocks for each in clock.stepped()]
    best = max(stepped, key=lambda each: each.log_likelihood, default=None)
    if best is not None and best.log_likelihood > clocks[0].log_likelihood + _STEP_EVIDENCE:
        first, stop = best.step()
        nothing = replace(nothing, steps=(first,))
        if not most_steps:
            return replace(nothing, why="it was set several times")
        before = photo_s < photo_s[first] - _MOST_STEP_S
        behind = photo_s > photo_s[min(stop, len(photo_s) - 1)] + _MOST_STEP_S
        parts = [
            (rows, _search(photo_s[rows], times_s, is_ordered[rows], resolution_s, clock_std_s, most_steps - 1))
            for rows in (np.flatnonzero(before), np.flatnonzero(behind))
        ]
        return _joined(nothing, parts, first)
    hypotheses: list[_Clock | _Stepped] = [*clocks, *stepped]
    logs = np.array([each.log_likelihood for each in hypotheses])
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    posterior = np.zeros((len(photo_s), len(times_s)))
    for weight, each in zip(weights.tolist(), hypotheses, strict=True):
        if weight > _NEGLIGIBLE_WEIGHT:
            posterior += weight * each.posterior()
    choice = np.argmax(posterior, axis=1)
    probability = posterior[np.arange(len(photo_s)), choice]
    certain = (probability >= MIN_PROBABILITY) & is_ordered
    explained = posterior.sum(axis=0)
    return _Found(choice=choice, probability=probability, certain=certain, explained=explained, clock=clocks[0])


def _joined(nothing: _Found, parts: list[tuple[IntArray, _Found]], first: int) -> _Found:
    """The matches of photos before and behind a step; those of the smaller part alone where they contradict another."""
    choice, probability, certain = nothing.choice.copy(), nothing.probability.copy(), nothing.certain.copy()
    told = [(rows, part) for rows, part in parts if np.count_nonzero(part.certain) >= _MIN_MATCHES]
    if not told:
        return nothing
    (before, earlier), (behind, later) = told[0], told[-1]
    if len(told) > 1 and earlier.choice[earlier.certain].max() >= later.choice[later.certain].min():
        return replace(nothing, why="parts of the flight are matched to the same triggers")
    for rows, part in told:
        choice[rows], probability[rows], certain[rows] = part.choice, part.probability, part.certain
    explained = np.maximum.reduce([part.explained for _, part in told])
    steps = (*(int(before[k]) for k in earlier.steps), first, *(int(behind[k]) for k in later.steps))
    _, largest = max(told, key=lambda each: np.count_nonzero(each[1].certain))
    return _Found(
        choice=choice,
        probability=probability,
        certain=certain,
        explained=explained,
        clock=largest.clock,
        steps=tuple(sorted(set(steps))),
    )


def _nothing(count: int, doubled: BoolArray, why: str, probability: FloatArray | None = None) -> PhotoMatches:
    nan = math.nan
    return PhotoMatches(
        trigger=np.full(count, -1),
        probability=np.zeros(count) if probability is None else probability,
        offset_s=nan,
        offset_std_s=nan,
        drift=nan,
        drift_std=nan,
        reference_s=nan,
        doubled=doubled,
        lost=np.zeros(len(doubled), dtype=np.bool_),
        why=why,
    )


def _doubled(trigger_s: FloatArray) -> BoolArray:
    """Triggers ``(t,)`` that follow one that counts by less than any camera needs."""
    doubled = np.zeros(len(trigger_s), dtype=np.bool_)
    steps = np.diff(trigger_s)
    if not len(steps):
        return doubled
    usual = steps[steps > 0.05]  # noqa: PLR2004 - s; messages that are repeated at once are none
    limit_s = min(_DOUBLED_S, _DOUBLED_SHARE * float(np.median(usual))) if len(usual) else _DOUBLED_S
    last_s = trigger_s[0]
    for k in range(1, len(trigger_s)):
        doubled[k] = trigger_s[k] - last_s < limit_s
        if not doubled[k]:
            last_s = trigger_s[k]
    return doubled


@dataclass(slots=True, eq=False)
class _Clock:
    """One clock of the camera, with the alignments that it makes likely."""

    photo_s: FloatArray
    times_s: FloatArray
    half_s: float
    reference_s: float
    offset_s: float
    drift: float
    jitter_s: float
    log_likelihood: float
    matches: FloatArray

    def posterior(self) -> FloatArray:
        """Probability ``(p, t)`` of each match."""
        return self.matches

    @property
    def noise_s(self) -> tuple[float, float]:
        """Half the stamps' resolution, and the jitter that an alignment allows for."""
        return self.half_s, max(self.jitter_s, _ALLOWED_JITTER_S)

    def evidence_per_match(self, chance: float) -> float:
        """Log likelihood above chance, by matched photo, of what lies between the first and the last match.

        Minus infinity where both most photos and most triggers lie elsewhere: strips of one interval fit by chance.
        """
        outside: list[int] = []
        for axis in (1, 0):
            likely = np.flatnonzero(self.matches.sum(axis=axis) > 0.5)  # noqa: PLR2004 - likelier matched than not
            if len(likely) < _MIN_MATCHES:
                return -math.inf
            outside.append(self.matches.shape[1 - axis] - int(likely[-1] - likely[0] + 1))
        if self.matches.sum() < _MIN_SHARE * min(self.matches.shape):
            return -math.inf
        ends = outside[0] * math.log(_EXTRA_AT_END) + outside[1] * math.log(_LOST_AT_END)
        return (self.log_likelihood - ends - chance) / float(self.matches.sum())

    def predicted_s(self) -> FloatArray:
        """UTC ``(p,)`` of the middle of each photo's stamp."""
        since_s = self.photo_s - self.reference_s
        return self.photo_s + self.half_s + self.offset_s + self.drift * since_s

    def sums(self, by_s: float = 0.0, alone: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Log sums ``(p + 1, t + 1)`` of alignments of the first photos, and of the last ones, reversed.

        Args:
            by_s: By how much the camera's clock is behind this one.
            alone: As of ``_entry``, for many sums of one shape.
        """
        span_s = max(float(np.ptp(self.photo_s)), 1.0)
        predicted_s = self.predicted_s() + by_s
        alone = _entry(len(predicted_s), len(self.times_s)) if alone is None else alone
        forward = _log_sums(predicted_s, self.times_s, *self.noise_s, span_s, alone)
        backward = _log_sums(-predicted_s[::-1].copy(), -self.times_s[::-1].copy(), *self.noise_s, span_s, alone)
        return forward, backward

    def stepped(self) -> "list[_Stepped]":
        """Hypotheses that the camera's clock was set once between two photos: this clock holds before, or behind."""
        spacing_s = max(self.half_s / 2, _JITTER_S)
        steps_s = np.arange(_LEAST_STEP_S, _MOST_STEP_S + spacing_s / 2, spacing_s)
        prior = math.log(_STEP) - math.log(4 * len(steps_s))
        alone = _entry(len(self.photo_s), len(self.times_s))
        forward, backward = self.sums(0.0, alone)
        found: list[_Stepped] = []
        for by_s in (*steps_s.tolist(), *(-steps_s).tolist()):
            stepped_forward, stepped_backward = self.sums(by_s, alone)
            for first, last, before_s, behind_s in (
                (forward, stepped_backward, 0.0, by_s),
                (stepped_forward, backward, by_s, 0.0),
            ):
                log = _log_of_switches(first, last) + prior + self.log_likelihood - float(forward[-1, -1])
                if log > self.log_likelihood - _NEGLIGIBLE:
                    found.append(_Stepped(self, before_s, behind_s, log))
        return found

    def refit(self) -> None:
        """Fit offset, drift and jitter to the likely matches: least squares, with a prior of the drift."""
        weight = self.matches
        total = float(weight.sum())
        if total < 1:
            return
        since_s = self.photo_s - self.reference_s
        residual_s = self.times_s[None] - (self.photo_s + self.half_s)[:, None]
        variance = self.half_s**2 / 3 + self.jitter_s**2
        rows, mean = weight.sum(axis=1), (weight * residual_s).sum(axis=1)
        normal = np.array(
            [[rows.sum(), rows @ since_s], [rows @ since_s, rows @ since_s**2 + variance / _DRIFT_STD**2]]
        )
        self.offset_s, self.drift = np.linalg.solve(normal, np.array([mean.sum(), mean @ since_s])).tolist()
        left_s = residual_s - self.offset_s - self.drift * since_s[:, None]
        spread = float((weight * left_s**2).sum()) / total
        self.jitter_s = math.sqrt(min(max(spread - self.half_s**2 / 3, _MIN_JITTER_S**2), _MAX_JITTER_S**2))

    def posterior_clock(self) -> tuple[float, float, float, float]:
        """Offset and drift with their standard deviations, by the stamps' own likelihood on a grid.

        Stamps that are cut at one phase, as of triggers on whole seconds, leave the offset open by the resolution: a
        least squares' standard deviation would hide that.
        """
        matched = np.flatnonzero(self.matches.max(axis=1) > MIN_PROBABILITY)
        since_s = self.photo_s[matched] - self.reference_s
        residual_s = self.times_s[np.argmax(self.matches[matched], axis=1)] - self.photo_s[matched] - self.half_s
        span_s = max(float(np.ptp(since_s)), 1.0)
        jitter_s = max(self.jitter_s, min(_ALLOWED_JITTER_S, _CUT_SHARE * self.half_s))
        step_s = 2 * (self.half_s + 2 * jitter_s)
        offsets = self.offset_s + np.linspace(-0.5, 0.5, _GRID) * step_s
        drifts = self.drift + np.linspace(-0.5, 0.5, _GRID // 4) * min(2 * step_s / span_s, 6 * _DRIFT_STD)
        logs = -0.5 * np.broadcast_to((drifts / _DRIFT_STD) ** 2, (len(offsets), len(drifts)))
        logs = logs + _grid_log_likelihood(residual_s, since_s, offsets, drifts, self.half_s, jitter_s)
        mass = np.exp(logs - logs.max())
        mass /= mass.sum()
        of_offset, of_drift = mass.sum(axis=1), mass.sum(axis=0)
        offset_s, drift = float(of_offset @ offsets), float(of_drift @ drifts)
        cell = (offsets[1] - offsets[0]) ** 2 / 12, (drifts[1] - drifts[0]) ** 2 / 12
        offset_std_s = math.sqrt(float(of_offset @ (offsets - offset_s) ** 2) + cell[0])
        drift_std = math.sqrt(float(of_drift @ (drifts - drift) ** 2) + cell[1])
        return offset_s, offset_std_s, drift, drift_std


@dataclass(frozen=True, slots=True, eq=False)
class _Stepped:
    """A clock that was set once between two photos, wherever: by how much it is behind ``clock`` before and behind."""

    clock: _Clock
    before_s: float
    behind_s: float
    log_likelihood: float

    def step(self) -> tuple[int, int]:
        """First and last of the photos before which the clock may have been set."""
        forward, backward = self.clock.sums(self.before_s)[0], self.clock.sums(self.behind_s)[1]
        logs = np.maximum(forward + backward[::-1, ::-1], _IMPOSSIBLE)
        by_photo = np.exp(logs - logs.max()).sum(axis=1)
        likely = np.flatnonzero(by_photo > _LIKELY_SWITCH * by_photo.sum())
        most = len(self.clock.photo_s) - 1
        return min(int(likely[0]), most), min(int(likely[-1]), most)

    def posterior(self) -> FloatArray:
        """Probability ``(p, t)`` of each match: before the step, or behind it."""
        clock = self.clock
        forward, backward = clock.sums(self.before_s)[0], clock.sums(self.behind_s)[1]
        total = _log_of_switches(forward, backward)
        span_s = max(float(np.ptp(clock.photo_s)), 1.0)
        before_s, behind_s = (clock.predicted_s() + by_s for by_s in (self.before_s, self.behind_s))
        times_s, noise = clock.times_s, clock.noise_s
        rest = _log_sums(-before_s[::-1].copy(), -times_s[::-1].copy(), *noise, span_s, backward)
        since = _log_sums(behind_s, times_s, *noise, span_s, forward)
        return _posterior(forward, rest, total, before_s, times_s, *noise) + _posterior(
            since, backward, total, behind_s, times_s, *noise
        )


def _entry(photos: int, triggers: int) -> FloatArray:
    """Log weights ``(p + 1, t + 1)`` of where alignments begin: before the first photo and trigger."""
    entry = np.full((photos + 1, triggers + 1), _IMPOSSIBLE)
    entry[0, 0] = 0.0
    return entry


class _Alignments:
    """The search for the camera's clock."""

    def __init__(self, photo_s: FloatArray, times_s: FloatArray, resolution_s: float, clock_std_s: float) -> None:
        self._photo_s, self._times_s = photo_s, times_s
        self._half_s, self._clock_std_s = resolution_s / 2, clock_std_s
        self._reference_s = float(np.mean(photo_s))

    def best(self) -> list[_Clock]:
        """Different clocks that explain the intervals, the likeliest first."""
        found: list[_Clock] = []
        for offset_s in self._voted():
            found = _likely([*found, self._fitted(offset_s)], _ROUGH_NATS)
        around_s = np.arange(-_PHASES, _PHASES + 1) / _PHASES * 4 * self._half_s
        for offset_s in (found[0].offset_s + around_s).tolist() if found else ():
            found = _likely([*found, self._fitted(offset_s)], _ROUGH_NATS)
        for clock in found:
            self._fit(clock, _ITERATIONS)
        chance = self._chance_log_likelihood()
        found = _likely(found, _NEGLIGIBLE)
        if not found or found[0].evidence_per_match(chance) <= _MIN_EVIDENCE:
            return []  # a clock that is less likely than a refused one is no better
        different: list[_Clock] = []
        for clock in found:
            if all(not _is_same(clock, other) for other in different):
                different.append(clock)
        return different

    def _chance_log_likelihood(self) -> float:
        """Log likelihood of photos that have nothing to do with the triggers, against one offset of all searched."""
        span_s = max(float(np.ptp(self._photo_s)), 1.0)
        searched = math.log(math.sqrt(2 * math.pi) * self._clock_std_s / (2 * self._half_s))
        return searched - len(self._photo_s) * math.log(span_s)

    def _voted(self) -> list[float]:
        """Offsets that most pairs of a photo and a trigger agree on, by their differences."""
        step = max(len(self._photo_s) // _MOST_VOTES, 1)
        votes = np.sort((self._times_s[None] - self._photo_s[::step, None] - self._half_s).ravel())
        width_s = 2 * self._half_s + 2 * _JITTER_S
        counts = np.searchsorted(votes, votes + width_s, side="right") - np.arange(len(votes))
        scores = counts - 0.5 * ((votes + width_s / 2) / self._clock_std_s) ** 2
        taken: list[float] = []
        for k in np.argsort(-scores, kind="stable").tolist():
            centre_s = float(np.mean(votes[k : k + counts[k]]))
            if all(abs(centre_s - each) > width_s / 2 for each in taken):
                taken.append(centre_s)
            if len(taken) == _CANDIDATES:
                break
        return taken

    def _fitted(self, offset_s: float) -> _Clock:
        clock = _Clock(
            self._photo_s,
            self._times_s,
            self._half_s,
            self._reference_s,
            offset_s,
            0.0,
            2 * _JITTER_S,
            -math.inf,
            np.zeros((len(self._photo_s), len(self._times_s))),
        )
        self._fit(clock, _ROUGH_ITERATIONS)
        return clock

    def _fit(self, clock: _Clock, iterations: int) -> None:
        for _ in range(iterations):
            self._align(clock)
            clock.refit()
        self._align(clock)

    def _align(self, clock: _Clock) -> None:
        """Sum over all alignments: the clock's likelihood, and the posterior of each match."""
        forward, backward = clock.sums()
        total = float(forward[-1, -1])
        clock.matches = _posterior(forward, backward, total, clock.predicted_s(), self._times_s, *clock.noise_s)
        prior = -0.5 * ((clock.offset_s / self._clock_std_s) ** 2 + (clock.drift / _DRIFT_STD) ** 2)
        clock.log_likelihood = float(forward[-1, -1]) + prior


def _likely(clocks: list[_Clock], within_nats: float) -> list[_Clock]:
    """The clocks near the best one, the likeliest first."""
    ordered = sorted(clocks, key=lambda each: -each.log_likelihood)
    return [each for each in ordered if each.log_likelihood >= ordered[0].log_likelihood - within_nats]


def _is_same(clock: _Clock, other: _Clock) -> bool:
    """Whether two clocks are one, found twice: most of their matches are the same."""
    return float((clock.matches * other.matches).sum()) > _MOSTLY * min(
        float(clock.matches.sum()), float(other.matches.sum())
    )


@njit
def _log_match(residual_s: float, half_s: float, jitter_s: float) -> float:
    """Log density of a trigger at a distance from the middle of a stamp: uniform by the cut, normal by the jitter."""
    if abs(residual_s) > half_s + _REACH * jitter_s:
        return _IMPOSSIBLE
    scale = jitter_s * math.sqrt(2.0)
    mass = 0.5 * (math.erf((residual_s + half_s) / scale) - math.erf((residual_s - half_s) / scale))
    return math.log(max(mass, 1e-12) / (2 * half_s))


@njit
def _log_sum(a: float, b: float) -> float:
    high, low = max(a, b), min(a, b)
    if high - low > _NEGLIGIBLE:
        return high
    return high + math.log1p(math.exp(low - high))


@njit
def _log_of_switches(forward: FloatArray, backward: FloatArray) -> float:
    """Log sum of all alignments that change from one clock's sums to those of another between two photos."""
    photos, triggers = forward.shape[0] - 1, forward.shape[1] - 1
    total = _IMPOSSIBLE
    for i in range(photos + 1):
        for j in range(triggers + 1):
            if forward[i, j] > _IMPOSSIBLE / 2:
                total = _log_sum(total, forward[i, j] + backward[photos - i, triggers - j])
    return total


@njit
def _log_sums(
    predicted_s: FloatArray, times_s: FloatArray, half_s: float, jitter_s: float, span_s: float, entry: FloatArray
) -> FloatArray:
    """Log likelihood ``(p + 1, t + 1)`` of all alignments of the first photos with the first triggers.

    ``entry (p + 1, t + 1)`` has the log weights of where alignments begin.

    Between two photos only triggers from those that the one may match to those that the other may count: elsewhere the
    order of lost triggers and extra photos makes no difference.
    """
    photos, triggers = len(predicted_s), len(times_s)
    reach_s = half_s + _REACH * jitter_s
    first = np.searchsorted(times_s, predicted_s - reach_s)
    stop = np.searchsorted(times_s, predicted_s + reach_s)
    sums = np.full((photos + 1, triggers + 1), _IMPOSSIBLE)
    extra, extra_at_end = math.log(_EXTRA / span_s), math.log(_EXTRA_AT_END / span_s)
    lost, lost_at_end, kept = math.log(_LOST), math.log(_LOST_AT_END), math.log(1 - _LOST)
    for i in range(photos + 1):
        begin = max(first[i - 1] - 2, 0) if i > 0 else 0
        end = min(stop[i] + 2, triggers) if i < photos else triggers
        for j in range(begin, end + 1):
            total = entry[i, j]
            if i > 0:
                total = _log_sum(total, sums[i - 1, j] + (extra_at_end if j % triggers == 0 else extra))
            if j > 0:
                total = _log_sum(total, sums[i, j - 1] + (lost_at_end if i % photos == 0 else lost))
            if i > 0 and j > 0:
                match = _log_match(times_s[j - 1] - predicted_s[i - 1], half_s, jitter_s)
                total = _log_sum(total, sums[i - 1, j - 1] + match + kept)
            sums[i, j] = total
    return sums


@njit
def _posterior(
    forward: FloatArray,
    backward: FloatArray,
    total: float,
    predicted_s: FloatArray,
    times_s: FloatArray,
    half_s: float,
    jitter_s: float,
) -> FloatArray:
    """Probability ``(p, t)`` of each match, by the sums from the start and those from the end, reversed."""
    photos, triggers = len(predicted_s), len(times_s)
    posterior = np.zeros((photos, triggers))
    kept = math.log(1 - _LOST)
    first = np.searchsorted(times_s, predicted_s - half_s - _REACH * jitter_s)
    stop = np.searchsorted(times_s, predicted_s + half_s + _REACH * jitter_s)
    for i in range(photos):
        for j in range(first[i], stop[i]):
            match = _log_match(times_s[j] - predicted_s[i], half_s, jitter_s)
            if match > _IMPOSSIBLE:
                rest = backward[photos - i - 1, triggers - j - 1]
                posterior[i, j] = math.exp(forward[i, j] + match + kept + rest - total)
    return posterior


@njit
def _grid_log_likelihood(
    residual_s: FloatArray,
    since_s: FloatArray,
    offsets: FloatArray,
    drifts: FloatArray,
    half_s: float,
    jitter_s: float,
) -> FloatArray:
    """Log likelihood ``(o, d)`` of matched stamps for offsets and drifts."""
    logs = np.zeros((len(offsets), len(drifts)))
    for i in range(len(offsets)):
        for k in range(len(drifts)):
            total = 0.0
            for n in range(len(residual_s)):
                match = _log_match(residual_s[n] - offsets[i] - drifts[k] * since_s[n], half_s, jitter_s)
                total += max(match, -1e4)
            logs[i, k] = total
    return logs
