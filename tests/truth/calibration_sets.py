"""What people calibrate, and from what: unknowns, and a way to draw evidence for them in a random world."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from aerodft.model import EvidenceSet, Prior, ProjectionModel
from calibration.pose import Problem, State, Unknowns
from calibration.pose.solve import solve

from .calibration_scenes import HEIGHT_PX, WIDTH_PX, ImpossibleError, World

POSE = ("east", "north", "height", "tilt", "roll", "heading")
LENS = ("focal", "fx", "fy", "cx", "cy", "k1", "k2")
DEG = math.radians(1.0)


@dataclass(frozen=True)
class Task:
    """A way to calibrate.

    Attributes:
        unknowns: Names.
        evidence: Draws it.
        priors: Standard deviations of what somebody says of unknowns: metres, radians; of a height its share.
        tilt_deg: Lowest and highest tilt.
    """

    unknowns: tuple[str, ...]
    evidence: Callable[[World], list]
    priors: dict[str, float] = field(default_factory=dict)
    tilt_deg: tuple[float, float] = (15.0, 70.0)


def several(make, name, fewest, most, **kind):
    """A drawn number of observations of one kind."""
    return lambda world: [
        make(world, f"{name}-{index}", **kind) for index in range(int(world.rng.integers(fewest, most + 1)))
    ]


def landmarks(fewest, most, **kind):
    return several(World.landmark, "landmark", fewest, most, **kind)


def ranges(fewest, most):
    return several(World.range_, "range", fewest, most)


def ground(fewest, most):
    return several(World.ground, "ground", fewest, most)


def lengths(fewest, most):
    return several(World.length, "length", fewest, most)


def heights(fewest, most):
    return several(World.height, "height", fewest, most)


def verticals(fewest, most):
    return several(World.vertical, "vertical", fewest, most)


def lines(fewest, most):
    """As many parallels as right angles."""
    return together(
        several(World.lines, "parallel", fewest, most, at_right_angle=False),
        several(World.lines, "right-angle", fewest, most, at_right_angle=True),
    )


def horizon(**kind):
    return several(World.horizon, "horizon", 1, 1, **kind)


def together(*parts):
    """One after another."""
    return lambda world: [each for part in parts for each in part(world)]


GUESSED = {"height": 0.1, "tilt": 3 * DEG, "roll": 2 * DEG}
TASKS = {
    "a pose from landmarks": Task(POSE, landmarks(8, 20), tilt_deg=(3.0, 72.0)),
    "a lens from landmarks": Task((*POSE, "focal", "k1", "k2"), landmarks(25, 35, most_above=0.4)),
    "an unknown camera": Task(
        ("height", "tilt", "roll", "heading", "fx", "fy", "cx", "cy"), landmarks(15, 25, most_above=0.4)
    ),
    "a pose from some of everything": Task(
        POSE,
        together(
            landmarks(5, 9), landmarks(1, 3, unknown=2), landmarks(0, 1, unknown=0), lengths(0, 2), ground(0, 1),
            ranges(1, 2), verticals(0, 2),
        ),
        priors={"height": 0.05, "heading": 5 * DEG},
    ),
    "water of unknown level": Task((*POSE, "elevation"), together(landmarks(8, 12), ranges(2, 3), lengths(1, 1))),
    "a laser rangefinder": Task(("height", "tilt"), ranges(4, 8), {"height": 0.1, "tilt": 3 * DEG}),
    "things of known size": Task(("height", "tilt", "roll"), together(lengths(3, 5), heights(2, 4)), GUESSED, (35, 72)),
    "lines and horizon": Task(
        ("height", "tilt", "roll", "focal"),
        together(horizon(count=4), lengths(3, 4), ranges(1, 2), verticals(0, 2)),
        GUESSED,
        (70, 82),
    ),
    "a building": Task(
        ("height", "tilt", "roll"), together(lines(1, 2), verticals(2, 3), lengths(2, 3)), GUESSED, (40, 72)
    ),
    "points from the foot": Task(("height", "tilt", "roll"), ground(4, 7), GUESSED),
}  # fmt: skip


def drawn(task, rng, std_px=(0.5, 1.0, 2.0), std_share=(0.0, 0.002)):
    """A world in which the task can be done, and what is known there: evidence and priors."""
    while True:
        stds = {"std_px": float(rng.choice(std_px)), "std_share": float(rng.choice(std_share))}
        world = World.random(rng, tilt_deg=task.tilt_deg, **stds)
        try:
            evidence = task.evidence(world)
        except ImpossibleError:
            continue
        stds = {name: std * (world.above_m if name == "height" else 1.0) for name, std in task.priors.items()}
        priors = {name: world.prior(name, std) for name, std in stds.items()}
        return world, EvidenceSet(evidence=tuple(evidence), priors=priors)


def guess(world, unknowns, priors: dict[str, Prior]):
    """What the solver is told: the truth of what is not asked for; priors; of the rest, nothing."""
    truth, lens = world.truth, world.camera
    ignorance = dict.fromkeys(truth, 0.0) | {"height": 10.0, "tilt": 1.0, "cx": (WIDTH_PX - 1) / 2}
    ignorance["cy"] = (HEIGHT_PX - 1) / 2
    zoom = world.rng.uniform(0.8, 1.25)
    ignorance |= {"focal": lens.fx_px * zoom, "fx": lens.fx_px * zoom, "fy": lens.fx_px * zoom}
    if "height" in unknowns and "elevation" not in unknowns:
        ignorance["height"] += world.elevation_m
    known = {name: ignorance[name] if name in unknowns else value for name, value in truth.items()}
    known |= {name: prior.value for name, prior in priors.items()}
    if "focal" in unknowns:
        known |= {"fx": known["focal"], "fy": known["focal"] * lens.fy_px / lens.fx_px}
    camera = replace(
        lens, fx_px=known["fx"], fy_px=known["fy"], cx_px=known["cx"], cy_px=known["cy"],
        distortion=(known["k1"], known["k2"], *lens.distortion[2:]),
    )  # fmt: skip
    position = np.array([known["east"], known["north"], known["height"]])
    return State.from_angles(camera, position, (known["tilt"], known["roll"], known["heading"]), known["elevation"])


def solved(task, world, known):
    """The solution, and the error of each unknown."""
    problem = Problem(known, Unknowns(task.unknowns), ProjectionModel.PINHOLE)
    is_good = set(task.unknowns) <= {*known.priors, *LENS}
    solution = solve(problem, guess(world, task.unknowns, known.priors), guess_is_good=is_good)
    truth = world.truth
    return solution, {name: _off(name, solution.state.value(name) - truth[name]) for name in task.unknowns}


def _off(name, error):
    return (error + math.pi) % (2 * math.pi) - math.pi if name in ("roll", "heading") else error


def with_outliers(known, rng, share=0.2):
    """A share of the observations, rounded up, is grossly wrong: another pixel, or another number."""
    wrong = set(rng.choice(len(known.evidence), math.ceil(share * len(known.evidence)), replace=False).tolist())
    evidence = tuple(_grossly_off(each, rng) if index in wrong else each for index, each in enumerate(known.evidence))
    return replace(known, evidence=evidence)


def _grossly_off(evidence, rng):
    if hasattr(evidence, "range_m"):
        return replace(evidence, range_m=evidence.range_m * rng.choice([rng.uniform(0.3, 0.8), rng.uniform(1.25, 3.0)]))
    return replace(evidence, pixel=tuple(rng.uniform([0, 0], [WIDTH_PX - 1, HEIGHT_PX - 1]).tolist()))
