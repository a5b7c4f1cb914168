"""Simulated survey flights: triggers, and the photos that a camera made of them."""

from dataclasses import dataclass, replace

import numpy as np

UTC_S = 1_795_221_168.0


@dataclass(frozen=True, slots=True)
class PhotoFlight:
    """A flight's messages and photos with their truth.

    Attributes:
        trigger_s: ``(t,)`` UTC of the messages.
        photo_s: ``(p,)`` stamps by the camera's clock, cut.
        truth: ``(p,)`` event of each photo; -1 for one without a trigger.
        is_ordered: ``(p,)`` whether names tell a photo's place among those of one stamp.
        offset_s: UTC of the triggers minus the camera's clock, at its mean stamp.
        drift: Of the camera's clock.
        events: ``(t,)`` event of each message: a doubled one has its first one's.
        lost: Events without a photo.
    """

    trigger_s: np.ndarray
    photo_s: np.ndarray
    truth: np.ndarray
    is_ordered: np.ndarray
    offset_s: float
    drift: float
    events: np.ndarray
    lost: np.ndarray


def photo_flight(seed: int, *, resolution_s: float = 1.0) -> PhotoFlight:
    """A survey in strips, flown by time or by distance in wind; photos lost, doubled, extra; messages doubled."""
    rng = np.random.default_rng(seed)
    interval_s = rng.choice([0.7, 1.0, 1.5, 2.0, 2.0, 3.0, 5.0])
    steps = []
    for _ in range(rng.integers(2, 9)):
        strip = rng.integers(6, 40)
        wobble = 0.0 if rng.random() < 0.3 else rng.uniform(0.0, 0.12)
        pace = interval_s * (rng.uniform(0.8, 1.3) if wobble else 1.0)
        steps += [*(pace * (1 + wobble * rng.standard_normal(strip)))]
        steps[-1] = rng.uniform(5.0, 25.0)  # a turn
    events_s = UTC_S + rng.uniform(0, 3600) + np.cumsum(np.maximum(steps, 0.5))
    is_double = rng.random(len(events_s)) < rng.choice([0.0, 0.02])
    order = np.sort(np.concatenate([np.arange(len(events_s)), np.flatnonzero(is_double)]))
    again = np.concatenate([[False], order[1:] == order[:-1]])
    trigger_s = events_s[order] + np.where(again, rng.uniform(0.02, 0.25, len(order)), 0.0)
    offset_s = rng.uniform(-3600, 3600)
    drift = rng.normal(0, 5e-5)
    lag_s = rng.uniform(0, 0.15) + rng.normal(0, rng.uniform(0.01, 0.08), len(events_s))
    is_lost = rng.random(len(events_s)) < rng.choice([0.0, 0.02, 0.08])
    if rng.random() < 0.3:
        is_lost[: rng.integers(1, 6)] = True
    if rng.random() < 0.2:
        is_lost[-rng.integers(1, 6) :] = True
    truth = np.flatnonzero(~is_lost)
    exposure_s = events_s[truth] + lag_s[truth]
    copies = truth[rng.random(len(truth)) < rng.choice([0.0, 0.01])]
    extra_s = rng.uniform(events_s[0], events_s[-1], rng.choice([0, 0, 1, 2]))
    near = np.abs(extra_s[:, None] - events_s[is_lost] - 0.075).min(axis=1, initial=np.inf)
    extra_s = extra_s[near > 1 + resolution_s]  # what is taken when a lost photo was due cannot be told from it
    before_s = events_s[0] - rng.uniform(20, 300, rng.choice([0, 0, 1, 3]))
    all_s = np.concatenate([exposure_s, events_s[copies] + lag_s[copies], extra_s, before_s])
    whose = np.concatenate([truth, copies, np.full(len(extra_s) + len(before_s), -1)])
    camera_s = all_s - offset_s - drift * (all_s - all_s.mean())
    shown_s = np.floor(camera_s / resolution_s) * resolution_s
    is_renumbered = rng.random() < 0.3
    names = rng.permutation(len(all_s)) if is_renumbered else np.argsort(np.argsort(camera_s, kind="stable"))
    order = np.lexsort((names, shown_s))
    shown_s, whose = shown_s[order], whose[order]
    tied = np.zeros(len(shown_s), dtype=bool)
    same = shown_s[1:] == shown_s[:-1]
    tied[1:] |= same
    tied[:-1] |= same
    is_ordered = ~tied | (not is_renumbered)
    events = np.searchsorted(events_s, trigger_s + 1e-9, side="right") - 1
    offset_s -= float(np.mean(lag_s[truth]))
    return PhotoFlight(trigger_s, shown_s, whose, is_ordered, offset_s, drift, events, np.flatnonzero(is_lost))


def with_step(flight: PhotoFlight, rng: np.random.Generator, *, whole_seconds: bool) -> PhotoFlight:
    """A flight whose camera's clock is set by 1 to 5 s, either way, at some photo; sorted by stamp as folders are."""
    count = len(flight.photo_s)
    first = int(rng.integers(max(1, count // 10), max(2, count - count // 10)))
    step_s = float(rng.uniform(1, 5) * rng.choice([-1, 1]))
    shown_s = flight.photo_s.copy()
    shown_s[first:] = np.floor(shown_s[first:] + (round(step_s) if whole_seconds else step_s))
    order = np.argsort(shown_s, kind="stable")
    return replace(flight, photo_s=shown_s[order], truth=flight.truth[order], is_ordered=flight.is_ordered[order])
