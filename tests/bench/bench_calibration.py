"""Height, tilt and one more angle from many landmarks: ``python tests/bench/bench_calibration.py [--peer]``.

With ``--peer``, beside CameraTransform's ``fit`` of the same landmarks, from the same start, in the same run; see
``bench_cameratransform.py`` for its environment. All times are the processor's, the shortest of several: what else a
machine does at the moment does not count. The peer has one thread, as we have: more would cost it more.
"""

import argparse
import json
import math
import os
import runpy
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from aerodft.geometry import rays_from_pixels
from aerodft.model import Camera, EvidenceSet, Landmark, Prior, ProjectionModel
from calibration.pose import Problem, State, Unknowns, calibrate
from calibration.pose.solve import solve

HERE = Path(__file__).parent
CAMERA = Camera(name="bench", width_px=1920, height_px=1080, fx_px=1500.0, fy_px=1500.0, cx_px=959.5, cy_px=539.5)
TRUTH_DEG = {
    "roll": {"tilt": 70.0, "roll": 3.0, "heading": 0.0},
    "heading": {"tilt": 70.0, "roll": 0.0, "heading": 40.0},
}
HEIGHT_M, START_M, START_DEG = 20.0, 10.0, math.degrees(1.0)


def landmarks(count: int, angles_deg: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Pixels ``(n, 2)``, each coordinate 1 px off, and points up to 2 m above the ground ``(n, 3)``."""
    rng = np.random.default_rng(1)
    angles = tuple(math.radians(angles_deg[name]) for name in ("tilt", "roll", "heading"))
    truth = State.from_angles(CAMERA, np.array([0.0, 0.0, HEIGHT_M]), angles)
    pixels = rng.uniform([50, 200], [1870, 1030], (count, 2))
    rays = rays_from_pixels(CAMERA, pixels) @ truth.rotation.T
    points = truth.position_m + rays * ((rng.uniform(0, 2, count) - HEIGHT_M) / rays[:, 2])[:, None]
    return pixels + rng.normal(size=pixels.shape), points


def best_s(runs: int, work: Callable[[], object]) -> float:
    """The shortest processor time of one run."""
    times_s = []
    for _ in range(runs):
        start_s = time.process_time()
        work()
        times_s.append(time.process_time() - start_s)
    return min(times_s)


def ours(pixels: np.ndarray, points: np.ndarray, third: str, runs: int) -> tuple[float, float, list[float]]:
    """Times of the solution and of the whole result, and what was found: metres and degrees."""
    known = EvidenceSet(
        evidence=tuple(
            Landmark(name=str(index), pixel=tuple(pixel), position_m=tuple(point))
            for index, (pixel, point) in enumerate(zip(pixels.tolist(), points.tolist(), strict=True))
        ),
        priors={name: Prior(value=0.0, std=0.0) for name in ("east", "north")},
    )
    names = ("height", "tilt", third)
    start = State.from_angles(CAMERA, np.array([0.0, 0.0, START_M]), (math.radians(START_DEG), 0.0, 0.0))
    solved_s = best_s(runs, lambda: solve(Problem(known, Unknowns(names), ProjectionModel.PINHOLE), start))
    whole_s = best_s(max(runs // 3, 1), lambda: calibrate(known, CAMERA, names))
    state = calibrate(known, CAMERA, names).solution.state
    return solved_s, whole_s, [state.value("height"), *(math.degrees(state.value(name)) for name in names[1:])]


def theirs(python: Path, pixels: np.ndarray, points: np.ndarray, third: str, runs: int) -> tuple[float, list[float]]:
    """The time of CameraTransform's fit, and what it found."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        np.save(folder / "pixels.npy", pixels)
        np.save(folder / "points.npy", points)
        start = {"elevation_m": START_M, "tilt_deg": START_DEG, f"{third}_deg": 0.0}
        task = {"focal_px": CAMERA.fx_px, "centre": [CAMERA.cx_px, CAMERA.cy_px], "start": start, "runs": runs}
        (folder / "task.json").write_text(json.dumps(task | {"size": [CAMERA.width_px, CAMERA.height_px]}))
        one_thread = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
        subprocess.run([python, HERE / "peer_fit.py", folder], check=True, env=os.environ | one_thread)
        answer = json.loads((folder / "answer.json").read_text())
    return answer["time_s"], answer["found"]


def main(arguments: list[str] | None = None) -> None:
    """Print times, their ratio, and what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--landmarks", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--runs", type=int, default=15)
    parser.add_argument("--peer", action="store_true", help="beside CameraTransform, with the first number")
    args = parser.parse_args(arguments)
    python = runpy.run_path(str(HERE / "bench_cameratransform.py"))["peer_python"]() if args.peer else None
    for third, angles_deg in TRUTH_DEG.items():
        for count in args.landmarks:
            pixels, points = landmarks(count, angles_deg)
            solved_s, whole_s, found = ours(pixels, points, third, args.runs)
            print(
                f"{count} landmarks, height, tilt, {third}: solved with covariance {solved_s * 1e3:.1f} ms, with each"
                f" observation's leave-one-out error {whole_s * 1e3:.1f} ms; {_said(found)}"
            )
            if python is not None and count == args.landmarks[0]:
                their_s, their_found = theirs(python, pixels, points, third, max(args.runs // 3, 1))
                print(
                    f"  CameraTransform.fit {their_s * 1e3:.0f} ms, {their_s / solved_s:.0f} times as long;"
                    f" {_said(their_found)}"
                )


def _said(found: list[float]) -> str:
    return ", ".join(f"{value:.3f}" for value in found)


if __name__ == "__main__":
    main()
