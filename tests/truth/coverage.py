"""What 95 % intervals hold over random scenes: asking the engine, and counting by depression below the horizon.

Depressions are drawn evenly within each bin, and a scene counts as much as its bin is wide, so that every table is of
scenes drawn evenly in depression, however many were drawn in a bin.
"""

import math
import os
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from aerodft.dft import Setup
from aerodft.model import ProbeKind, Status
from tests.one_image import measure

from .random_scenes import PIXELS, TOP, Level, Said, random_scene, truths
from .scenes import depression_rad, opencv_rays

BINS_DEG = (0, 3, 6, 10, 20, 45, 90)
CELLS = tuple(range(len(BINS_DEG) - 1))
TIMES = 3 if os.environ.get("AERODFT_FAULTS") == "full" else 1
FEWEST = 420 * TIMES
"""Answers in a cell, so that its coverage is known to 1.1 % (one std; 0.6 %) where 3 % are allowed: intervals that hold
89 % in one cell are seen 98 times in 100. Over all, where wide bins count most, 750 scenes in each of these
tell the coverage to 0.5 %: 93 % instead of 95 % is seen 97 times in 100."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One probe's answer, and how far below the horizon its highest ground point is and was seen.

    Whether the interval holds the truth is None without an answer.
    """

    truly_below_deg: float
    below_deg: float
    status: Status
    holds: bool | None


def holds(answer, truth):
    if answer.kind == ProbeKind.POSITION:
        ellipse = answer.ellipse95
        sin, cos = math.sin(ellipse.azimuth_rad), math.cos(ellipse.azimuth_rad)
        along, across = np.array([[sin, cos], [cos, -sin]]) @ (truth - answer.enu_m[0][:2])
        return (along / ellipse.semi_major_m) ** 2 + (across / ellipse.semi_minor_m) ** 2 <= 1
    low, high = answer.ci95
    if answer.kind == ProbeKind.BEARING:
        return (truth - low) % 360 <= high - low
    return low <= truth <= high


def ask(said, elevation_m):
    """What the engine answers to every probe, by its name."""
    answers = measure(Setup(camera=said.scene.camera), said.sample, tuple(said.request(name) for name in PIXELS))
    true = truths(said.scene, elevation_m)
    rays_enu = opencv_rays(said.scene.camera, said.pixels_px[:TOP]) @ said.axes_enu.T
    seen = np.degrees(depression_rad(rays_enu))
    there = np.degrees(depression_rad(said.scene.points_m - [0.0, 0.0, said.scene.height_m]))
    outcomes = {}
    for (name, (_, rows)), answer in zip(PIXELS.items(), answers, strict=True):
        ground = [row for row in rows if row != TOP]
        held = holds(answer, true[name]) if answer.status is Status.OK else None
        outcomes[name] = Outcome(float(there[ground].min()), float(seen[ground].min()), answer.status, held)
    return outcomes


def plain_width(said, elevation_m):
    """Whether a width's interval by linear propagation alone holds the truth; None where a ray is above the horizon."""
    step = 1e-4
    errors = step * np.vstack([np.eye(8), -np.eye(8), np.zeros(8)])  # four of pixels, three of attitude, one of height
    pixels = said.pixels_px[:2] + errors[:, :4].reshape(-1, 2, 2) * said.level.std_px
    turns = Rotation.from_rotvec(errors[:, 4:7] * math.radians(said.level.angle_deg)).as_matrix()
    drop = said.height_m - said.elevation_m + errors[:, 7] * math.sqrt(2) * said.height_std_m  # camera's and plane's
    rays = opencv_rays(said.scene.camera, pixels.reshape(-1, 2)).reshape(-1, 2, 3)
    east, north, up = np.moveaxis(np.einsum("ij,njk,nlk->nli", said.axes_enu, turns, rays), -1, 0)
    if np.any(up >= 0):
        return None
    width = np.hypot(np.diff(east / up), np.diff(north / up))[:, 0] * drop
    std = np.linalg.norm((width[:8] - width[8:16]) / (2 * step))
    return abs(truths(said.scene, elevation_m)["width"] - width[16]) <= norm.ppf(0.975) * std


@dataclass(slots=True)
class Cell:
    """Scenes of one probe in one bin; sums of weights, and how many answers there are."""

    drawn: float = 0.0
    answered: float = 0.0
    held: float = 0.0
    ill: float = 0.0
    answers: int = 0

    def add(self, outcome, weight):
        self.drawn += weight
        self.ill += weight * (outcome.status is Status.ILL_CONDITIONED)
        if outcome.holds is not None:
            self.answered += weight
            self.held += weight * outcome.holds
            self.answers += 1

    @property
    def coverage(self):
        return self.held / self.answered if self.answers else math.nan

    def __str__(self):
        return f"{self.coverage:6.1%} of {self.answers:5d}, {self.ill / self.drawn:5.1%}"


@dataclass(slots=True)
class Tally:
    """All cells of a level, by measured and by true depression, and what plain first order does for widths."""

    level: Level
    by_measured: dict = field(default_factory=lambda: defaultdict(Cell))
    by_true: dict = field(default_factory=lambda: defaultdict(Cell))
    plain: list = field(default_factory=list)

    @classmethod
    def of(cls, level, scenes):
        """``scenes`` says how many are drawn in each bin; three times as many where ``AERODFT_FAULTS=full``."""
        tally = cls(level)
        for cell, count in enumerate(TIMES * each for each in scenes):
            rng = np.random.default_rng([cell, count])
            low, high = BINS_DEG[cell : cell + 2]
            for _ in range(count):
                scene = random_scene(rng, math.radians(rng.uniform(low, high)))
                said, elevation_m = Said.of(rng, scene, level)
                tally.add(said, elevation_m, (high - low) / count)
        return tally

    def add(self, said, elevation_m, weight):
        for name, outcome in ask(said, elevation_m).items():
            self.by_true[name, bin_of(outcome.truly_below_deg)].add(outcome, weight)
            if outcome.below_deg > 0:
                self.by_measured[name, bin_of(outcome.below_deg)].add(outcome, weight)
            if name == "width" and outcome.truly_below_deg < BINS_DEG[1]:
                self.plain.append((outcome.holds, plain_width(said, elevation_m)))

    def over_all(self, name):
        """Every scene of a probe, drawn evenly in depression."""
        cells = [cell for (each, _), cell in self.by_true.items() if each == name]
        return Cell(*(sum(getattr(cell, part) for cell in cells) for part in Cell.__slots__))

    def table(self, name):
        bins = "".join(f"{low:2d} to {high:2d} deg below      " for low, high in pairwise(BINS_DEG))
        lines = [f"{name}, {self.level}: share of intervals that hold the truth, of answers, ill-conditioned share"]
        for title, cells in (("by measured", self.by_measured), ("by true", self.by_true)):
            lines.append(f"  {title:11s}  " + "  ".join(str(cells[name, cell]) for cell in CELLS))
        return "\n".join(["", lines[0], " " * 15 + bins, *lines[1:], f"  over all     {self.over_all(name)}"])

    def assert_holds(self, name):
        """92 to 98 % in every cell that has answers, 94 to 96 % over all.

        By true depression that is asked where at least three quarters of the scenes are answered: elsewhere the answers
        are a choice of those scenes whose errors let them look safe.
        """
        measured = [self.by_measured[name, cell] for cell in CELLS]
        answered = [cell for cell in measured if cell.answers]
        truly = [self.by_true[name, cell] for cell in CELLS]
        assert len(answered) >= len(CELLS) - 1, self.table(name)
        assert all(cell.answers >= FEWEST for cell in answered), self.table(name)
        for cell in [*answered, *(cell for cell in truly if cell.answered >= 0.75 * cell.drawn)]:
            assert 0.92 <= cell.coverage <= 0.98, self.table(name)
        assert 0.94 <= self.over_all(name).coverage <= 0.96, self.table(name)
        assert 0.94 <= np.mean([cell.coverage for cell in answered]) <= 0.96, self.table(name)


def bin_of(below_deg):
    return min(int(np.searchsorted(BINS_DEG, below_deg)) - 1, CELLS[-1])
