"""What a flight's telemetry gives: poses as an import would make them, and heights that contradict each other."""

import math
import re
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.dft import Request, measure
from aerodft.diagnosis.camera_pitch import CameraPitches
from aerodft.model import (
    CODE_OF,
    CODES,
    BoolArray,
    Camera,
    HeightDifference,
    HeightSource,
    IntArray,
    PoseBatch,
    Probe,
    ProbeKind,
    Status,
)
from aerodft.service import LAST, Calibrator, PipelineSettings, TelemetrySettings, fixed_requests
from aerodft.service.pose import PoseSource, over_water

_FINE_FOR_NS: Final = 10 * SECOND_NS  # a link is listened to for that long
_MOST_MOMENTS, _FEWEST_MOMENTS = 2000, 50  # asked for at once: the fewer, the more often the clock has jumped
_FINE_NS: Final = SECOND_NS // 10
_MOST_TOLD: Final = 3
_RARE: Final = 0.02  # share of a flight
_NUMBER: Final = re.compile(r"[-+]?\d+(\.\d+)?")
_FEW: Final = 0.1  # share of the comparisons; noise makes one in twenty


@dataclass(slots=True)
class PoseReason:
    """What was said of poses at moments of one status.

    Attributes:
        text: As it was said first; empty of poses that are there.
        first_s: When that was, since the first frame.
        seconds: How long it was said, whatever its numbers were.
    """

    text: str
    first_s: float
    seconds: float = 0.0


@dataclass(slots=True)
class PoseAvailability:
    """Time of a flight by status of its poses.

    Attributes:
        spans: What was said of each status, by the words without their numbers.
        seen_s: For how long the probes, or some part of the image, could be measured.
    """

    spans: dict[Status, dict[str, PoseReason]] = field(default_factory=dict)
    seen_s: float = 0.0

    @property
    def seconds(self) -> float:
        """Length of the flight."""
        return sum(map(self._seconds, self.spans))

    @property
    def ok_s(self) -> float:
        """For how long images could be measured."""
        return self._seconds(Status.OK)

    def _seconds(self, status: Status) -> float:
        return sum(each.seconds for each in self.spans.get(status, {}).values())

    def add(self, status: Status, reason: str, at_s: float, seconds: float) -> None:
        """Count one moment."""
        reasons = self.spans.setdefault(status, {})
        reasons.setdefault(_NUMBER.sub("", reason), PoseReason(reason, at_s)).seconds += seconds

    def document(self) -> dict[str, Any]:
        """Plain JSON values."""
        worst = {str(status): round(seconds, 1) for status, seconds in self._faults()}
        return {"seconds": round(self.seconds, 1), "ok_s": round(self.ok_s, 1), "no_answer_s": worst}

    def _faults(self) -> list[tuple[Status, float]]:
        """Statuses without a pose and for how long, the longest first."""
        faults = ((status, self._seconds(status)) for status in self.spans if status is not Status.OK)
        return sorted(faults, key=lambda item: -item[1])

    def note(self) -> str:
        """For how long there is a pose, and why there is none for the rest."""
        listed = ", ".join(f"{status} in {seconds:.0f} s" for status, seconds in self._faults() if seconds >= 1)
        found = f"images could be measured in {self.ok_s:.0f} of {self.seconds:.0f} s"
        return f"{found}; {listed}" if listed else found

    def problem(self) -> str:
        """Why most images would have no answer; empty where most have one."""
        if self.ok_s * 2 > self.seconds:
            return ""
        told = [each for each in self._faults()[:_MOST_TOLD] if each[1] > _RARE * self.seconds]
        listed = "; ".join(f"{status} in {seconds:.0f} s ({self._example(status)})" for status, seconds in told)
        if self.ok_s == 0:
            return f"no {'probe' if self.seen_s else 'image'} could be measured: {listed}"
        return f"images could be measured only in {self.ok_s:.0f} of {self.seconds:.0f} s: {listed}"

    def _example(self, status: Status) -> str:
        """The reason stated for the longest time, and when it first was."""
        reason = max(self.spans[status].values(), key=lambda each: each.seconds)
        return f"first {reason.first_s:.0f} s after the start: {reason.text}"


_ANY_CAMERA: Final = Camera.from_fov(  # chosen: video of a drone with 82 deg of diagonal; narrower ones see less ground
    name="any", width_px=1920, height_px=1080, hfov_rad=math.radians(73), vfov_rad=math.radians(45)
)
_FIRST_PIXEL: Final = re.compile(r"^(pixel 0 \([^)]*\)|point 0)")  # as reasons call it


class ImageAnswer(NamedTuple):
    """What an import would answer in one image.

    Attributes:
        status: OK where any fixed probe has an answer, or any point around the image's middle where there is no probe;
            else the first one's.
        reason: Why there is no answer; else empty.
        is_seen: Whether a probe or any point around the image's middle has an answer.
    """

    status: Status
    reason: str
    is_seen: bool


class ImageCheck:
    """Measures in images at poses as an import does: the fixed probes, the image's middle and its borders' middles.

    Args:
        pipeline: The station's settings; None for the telemetry's alone.
        telemetry: Sources, stds and limits where there is no station; None for the defaults.
        camera: What measures where there is no station; None for a usual one.
        calibrator: Refines the poses; None for unrefined ones.

    Attributes:
        pitches: Where the camera looks, by the sources of its attitude.
    """

    def __init__(
        self,
        pipeline: PipelineSettings | None = None,
        *,
        telemetry: TelemetrySettings | None = None,
        camera: Camera | None = None,
        calibrator: Calibrator[Any] | None = None,
    ) -> None:
        self.pitches = CameraPitches()
        self._zooms = pipeline is not None
        self._pipeline = pipeline or PipelineSettings(
            station="", camera=camera or _ANY_CAMERA, probes=(), telemetry=telemetry
        )
        self._calibrator = calibrator
        self._probes = fixed_requests(self._pipeline.probes)
        self._around = _around_the_middle(self._pipeline.camera)

    @property
    def telemetry(self) -> TelemetrySettings | None:
        """Sources, stds and limits of the poses; None for the defaults."""
        return self._pipeline.telemetry

    def pose_source(self) -> PoseSource:
        """Poses by the station's settings, from no telemetry yet."""
        settings = self._pipeline
        return PoseSource(
            settings.telemetry or TelemetrySettings(),
            origin=settings.origin,
            time_std_s=settings.time_std_s,
            ground=settings.ground,
            camera=settings.camera if self._zooms else None,
            level=settings.level,
        )

    def answers(self, poses: PoseBatch) -> list[ImageAnswer]:
        """What an import would answer in the images ``(n,)`` at unrefined poses."""
        if self._calibrator is not None:
            states, which = [self._calibrator.known()], np.zeros(len(poses), dtype=np.int64)
            poses = self._calibrator.refine(poses, states, which)
        poses = over_water(poses, self._pipeline.level)
        columns = measure(self._pipeline.setup, poses, (*self._probes, *self._around)).columns
        is_ok: BoolArray = np.stack([column.status for column in columns]) == CODE_OF[Status.OK]
        of_probes, is_seen = is_ok[: len(self._probes)], np.asarray(np.any(is_ok, axis=0))
        is_answered = np.asarray(np.any(of_probes, axis=0)) if self._probes else is_seen
        self.pitches.add(poses, is_answered if self._probes else is_ok[0])
        first, found = columns[0], []
        variants = zip(first.status.tolist(), poses.variant_of_each, strict=True)
        for row, (code, variant) in enumerate(variants):
            reason = next(iter(first.reasons.get(row, variant.reasons)), "")
            reason = reason if self._probes else _FIRST_PIXEL.sub("the image's middle", reason)
            status, reason = (Status.OK, "") if is_answered[row] else (CODES[code], reason)
            found.append(ImageAnswer(status, reason, bool(is_seen[row])))
        return found


def _around_the_middle(camera: Camera) -> tuple[Request, ...]:
    """Positions at the image's middle and at the middles of its borders."""
    right, down = camera.width_px - 1.0, camera.height_px - 1.0
    pixels = {
        "middle": (right / 2, down / 2),
        "bottom": (right / 2, down),
        "top": (right / 2, 0.0),
        "left": (0.0, down / 2),
        "right": (right, down / 2),
    }
    probes = (Probe(name=name, kind=ProbeKind.POSITION, pixels=(at,)) for name, at in pixels.items())
    return fixed_requests(tuple(probes))


class PoseSampler:
    """Asks for a pose at every tenth of a second of a link, at every second of a long log.

    Args:
        source: Takes in the telemetry; is asked.
        images: Measures at the poses; None where a pose alone counts.
    """

    def __init__(self, source: PoseSource, images: ImageCheck | None = None) -> None:
        self._source = source
        self._images = images
        self._poses = PoseAvailability()
        self._waiting: deque[tuple[int, int]] = deque()
        self._first_ns: int | None = None
        self._next_ns = 0
        self._most = _MOST_MOMENTS

    def add(self, first_ns: int, now_ns: int) -> None:
        """Ask for what may be known now that telemetry was taken in that arrived between these (host UTC)."""
        if self._first_ns is None:
            self._first_ns = self._next_ns = first_ns
        least_ns = (now_ns - self._next_ns) // self._most  # a clock may jump by decades, again and again
        if least_ns > SECOND_NS:
            self._most = max(self._most // 2, _FEWEST_MOMENTS)
        while self._next_ns <= now_ns:
            usual_ns = _FINE_NS if self._next_ns - self._first_ns < _FINE_FOR_NS else SECOND_NS
            step_ns = max(usual_ns, min(least_ns, now_ns - self._next_ns))
            self._waiting.append((self._next_ns, step_ns))
            self._next_ns += step_ns
        self._ask(is_final=False)

    def add_stamps(self, stamps_ns: IntArray) -> None:
        """Ask for what is known at stamps ``(n,)`` of telemetry that holds at these alone, now that it was taken in."""
        if self._first_ns is None:
            self._first_ns = int(stamps_ns[0])
        self._waiting.extend((stamp_ns, SECOND_NS) for stamp_ns in stamps_ns.tolist())
        self._ask(is_final=False)

    def poses(self) -> PoseAvailability:
        """Availability of all poses, with the telemetry at hand."""
        self._ask(is_final=True)
        return self._poses

    def _ask(self, *, is_final: bool) -> None:
        """Ask for the poses at the moments that wait, up to the first whose telemetry may still come."""
        if not self._waiting:
            return
        arrivals_ns = np.array([arrival_ns for arrival_ns, _ in self._waiting])
        ticks, no = np.broadcast_to(LAST, arrivals_ns.shape), np.full(len(arrivals_ns), fill_value=False)
        stamps_ns = self._source.clock.host_to_utc(arrivals_ns, ticks)
        poses, is_pending = self._source.at(stamps_ns, ticks, is_final=no | is_final, by_utc=no)
        count = int(np.argmax(is_pending)) if np.any(is_pending) else len(is_pending)
        if not count:
            return
        for status, reason, is_seen in self._answers(poses[:count]):
            arrival_ns, step_ns = self._waiting.popleft()
            # A pose speaks for no more than a second, the silence of a clock that jumped for all of it.
            spoken_ns = min(step_ns, SECOND_NS) if status is Status.OK else step_ns
            self._poses.add(status, reason, (arrival_ns - (self._first_ns or 0)) / SECOND_NS, spoken_ns / SECOND_NS)
            self._poses.seen_s += is_seen * min(step_ns, SECOND_NS) / SECOND_NS

    def _answers(self, poses: PoseBatch) -> list[ImageAnswer]:
        if self._images is not None:
            return self._images.answers(poses)
        return [
            ImageAnswer(
                each.status, "" if each.status is Status.OK else next(iter(each.reasons), ""), each.status is Status.OK
            )
            for each in poses
        ]


@dataclass(slots=True)
class HeightPair:
    """Two sources over a flight.

    Attributes:
        steps_m: The second one minus the first, once a second where both spoke.
        stamps_ns: When (UTC).
        beyond: In how many of these that is more than their stds explain.
    """

    steps_m: list[float] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    beyond: int = 0

    def add(self, difference: HeightDifference) -> None:
        """Count one comparison, at most one a second."""
        if self.stamps_ns and abs(difference.stamp_ns - self.stamps_ns[-1]) < SECOND_NS:
            return
        self.steps_m.append(difference.step_m)
        self.stamps_ns.append(difference.stamp_ns)
        self.beyond += difference.is_significant

    @property
    def disagrees(self) -> bool:
        """Whether the two differ more often than by chance."""
        return self.beyond > _FEW * len(self.steps_m)

    @property
    def offset_text(self) -> str:
        """Words for the second source's offset from the first."""
        median_m = float(np.median(self.steps_m))
        return f"{abs(median_m):.2f} m {'below' if median_m < 0 else 'above'}"

    def sentence(self, first: str, second: str, advice: str) -> str:
        """Sentence on the difference of the two, and what to do."""
        return (
            f"heights disagree: {second} is {self.offset_text} {first} in the median "
            f"({min(self.steps_m):+.2f} to {max(self.steps_m):+.2f} m), beyond their std in {self.beyond} of "
            f"{len(self.steps_m)} comparisons: {advice}"
        )


class HeightPairs:
    """All pairs of height sources that spoke at the same time."""

    def __init__(self) -> None:
        self._pairs: dict[tuple[str, str], HeightPair] = {}

    def add(self, differences: list[HeightDifference]) -> None:
        """Take in what the sources said at one time."""
        for each in differences:
            self._pairs.setdefault((str(each.source), str(each.other)), HeightPair()).add(each)

    def documents(self) -> list[dict[str, Any]]:
        """Plain JSON values, one document a pair."""
        return [
            {
                "source": first,
                "other": second,
                "compared": len(pair.steps_m),
                "beyond_std": pair.beyond,
                "step_median_m": round(float(np.median(pair.steps_m)), 3),
                "step_low_m": round(min(pair.steps_m), 3),
                "step_high_m": round(max(pair.steps_m), 3),
            }
            for (first, second), pair in self._pairs.items()
        ]

    def sentences(self, home_above_plane_m: float = 0.0) -> list[str]:
        """One sentence for each pair that disagrees more often than by chance; one for a source that is alone.

        Args:
            home_above_plane_m: What is added to heights above home, of which a better one may follow.
        """
        disagreeing = {names: pair for names, pair in self._pairs.items() if pair.disagrees}
        for outlier in dict.fromkeys(name for names in disagreeing for name in names):
            others = {
                _other_source(names, outlier): _as_second(names, pair, outlier)
                for names, pair in disagreeing.items()
                if outlier in names
            }
            pairs = [pair for names, pair in self._pairs.items() if set(names) <= set(others)]
            if len(others) > 1 and pairs and not any(pair.disagrees for pair in pairs):
                rest = {names: pair for names, pair in disagreeing.items() if outlier not in names}
                return [_outlier_sentence(outlier, others, home_above_plane_m), *_sentences(rest, home_above_plane_m)]
        return _sentences(disagreeing, home_above_plane_m)


def _sentences(disagreeing: dict[tuple[str, str], HeightPair], home_above_plane_m: float) -> list[str]:
    """One sentence for each pair."""
    sentences = []
    for names, pair in disagreeing.items():
        outlier = str(HeightSource.HOME) if HeightSource.HOME in names else names[1]
        advice = _advice(outlier, _as_second(names, pair, outlier).steps_m, home_above_plane_m)
        sentences.append(pair.sentence(*names, f"if {_other_source(names, outlier)} is right, {advice}"))
    return sentences


def _advice(name: str, steps_m: list[float], home_above_plane_m: float) -> str:
    """Advice about a source that is so far above others which speak of the ground below."""
    if name != HeightSource.HOME:
        return "take it out of telemetry.height.order, or see std_m"
    middle_m = float(np.median(steps_m))
    if max(steps_m) - min(steps_m) < abs(middle_m):
        return f"set telemetry.height.home_above_plane_m = {round(home_above_plane_m - middle_m, 1) + 0.0:g}"
    return (
        "the ground below is not level with home: measure by what speaks of it (telemetry.height.order), and describe "
        "ground that is no plane in [ground]"
    )


def _other_source(names: tuple[str, str], name: str) -> str:
    return names[1] if name == names[0] else names[0]


def _as_second(names: tuple[str, str], pair: HeightPair, name: str) -> HeightPair:
    """The pair with this source as the second one."""
    if name == names[1]:
        return pair
    return HeightPair(steps_m=[-step_m for step_m in pair.steps_m], stamps_ns=pair.stamps_ns, beyond=pair.beyond)


def _outlier_sentence(name: str, others: dict[str, HeightPair], home_above_plane_m: float) -> str:
    """Sentence on one source that contradicts others, which agree; and what to do."""
    steps_m = [step_m for pair in others.values() for step_m in pair.steps_m]
    offset_text = " and ".join(f"{pair.offset_text} {other}" for other, pair in others.items())
    beyond = " and ".join(f"{pair.beyond} of {len(pair.steps_m)}" for pair in others.values())
    return (
        f"heights disagree: {name} is {offset_text} in the median ({min(steps_m):+.2f} to {max(steps_m):+.2f} m), "
        f"beyond their std in {beyond} comparisons, while {' and '.join(others)} agree: "
        f"{_advice(name, steps_m, home_above_plane_m)}"
    )
