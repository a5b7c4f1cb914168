"""Beside CameraTransform 1.2.1: speed and places of many pixels, and heights of an upright object.

``python tests/bench/bench_cameratransform.py [--pixels N]``: the peer lives in an environment of its own beside
``.venv``, ``.venv-peer``, which is made at the first run; that needs the network.
"""

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

import aerodft as ad
from aerodft.dft import Request, Setup
from aerodft.geometry import camera_pose, matrix, pixels_from_rays
from aerodft.model import Camera, Pose, PoseSample, Probe, ProbeKind, Status
from tests.one_image import measure

PEER = "cameratransform==1.2.1"
HERE = Path(__file__).parent
ENVIRONMENT = HERE.parents[1] / ".venv-peer"
CAMERA = Camera.from_fov(
    name="bench", width_px=3840, height_px=2160, hfov_rad=math.radians(70.0), vfov_rad=math.radians(43.0)
)
LENSES = {"straight": (0.0, 0.0, 0.0), "radial": (-0.1, 0.02, 0.0)}
POSE = {"height_agl_m": 50.0, "tilt_deg": 60.0, "roll_deg": 3.0, "heading_deg": 40.0}
CAMERA_POSE = ad.CameraPose(height_m=50.0, tilt_deg=60.0, roll_deg=3.0, heading_deg=40.0)
OBJECT_M, AWAY_M, STD_PX = 2.0, 60.0, 1.0
SCENES = [(0.0, 0.0), (0.0, 0.1), (0.0, 1.0), (0.0, 5.0), (0.0, 30.0), (45.0, 0.0), (45.0, 30.0), (90.0, 0.0)]
"""Heading of the camera, and how far the object stands to the right of its axis, in degrees."""


def succeeds(*command: str | Path) -> bool:
    """Whether it runs and leaves with 0."""
    try:
        return subprocess.run(command, check=False, capture_output=True).returncode == 0
    except FileNotFoundError:
        return False


def peer_python() -> Path:
    """Python of the peer's environment, which is made where it is missing; leaves with a sentence where it cannot."""
    python = ENVIRONMENT / "bin/python"
    if not succeeds(python, "-c", "import cameratransform"):
        print(f"installing {PEER} in {ENVIRONMENT.name}", flush=True)
        pip = (python, "-m", "pip", "install", "--disable-pip-version-check", "--retries", "1", "--timeout", "10", PEER)
        if not (succeeds(sys.executable, "-m", "venv", ENVIRONMENT) and succeeds(*pip)):
            sys.exit(f"{PEER} cannot be installed in {ENVIRONMENT.name}: that needs the network, once.")
    return python


def pose_of(pose: dict[str, float]) -> Pose:
    """The pose in aerodft's terms."""
    angles = {f"{name}_rad": math.radians(pose[f"{name}_deg"]) for name in ("tilt", "roll", "heading")}
    return camera_pose(height_agl_m=pose["height_agl_m"], **angles)


def seen_at(camera: Camera, pose: Pose, points_enu_m: np.ndarray) -> np.ndarray:
    """Pixels of points."""
    return pixels_from_rays(camera, (points_enu_m - pose.position_enu_m) @ matrix(pose.wxyz))


def upright_objects(draws: int) -> list[tuple[dict[str, float], Pose, np.ndarray]]:
    """For every scene its pose, and base and top of the object ``(1 + draws, 2, 2)``: as it is, then picked badly."""
    rng, scenes = np.random.default_rng(4), []
    for heading_deg, aside_deg in SCENES:
        terms = {"height_agl_m": 20.0, "tilt_deg": 70.0, "roll_deg": 0.0, "heading_deg": heading_deg}
        azimuth = math.radians(heading_deg + aside_deg)
        foot = np.array([math.sin(azimuth), math.cos(azimuth), 0.0]) * AWAY_M
        exact = seen_at(CAMERA, pose_of(terms), np.stack([foot, foot + [0.0, 0.0, OBJECT_M]]))
        scenes.append(
            (terms, pose_of(terms), exact + STD_PX * np.vstack([[exact * 0], rng.normal(size=(draws, 2, 2))]))
        )
    return scenes


def heights(pose: Pose, pixels: np.ndarray) -> tuple[np.ndarray, float]:
    """Heights by aerodft, and the standard deviation that it states for the first."""
    probe = Probe(name="object", kind=ProbeKind.HEIGHT, pixels=((0.0, 0.0), (0.0, 1.0)))
    asked = tuple(Request(probe=probe, pixels=tuple(map(tuple, pair)), std_px=STD_PX) for pair in pixels.tolist())
    found = measure(Setup(camera=CAMERA), PoseSample(stamp_ns=0, status=Status.OK, pose=pose), asked)
    return np.array([each.value for each in found]), found[0].std


def best_s(work: Callable[[], object], runs: int) -> float:
    """The shortest time."""
    best = math.inf
    for _ in range(runs):
        start_s = time.process_time()
        work()
        best = min(best, time.process_time() - start_s)
    return best


def write_task(folder: Path, pixels: np.ndarray, scenes: list, runs: int) -> None:
    """What the peer reads."""
    np.save(folder / "pixels.npy", pixels)
    for index, (_, _, pairs) in enumerate(scenes):
        np.save(folder / f"feet{index}.npy", pairs[:, 0])
        np.save(folder / f"heads{index}.npy", pairs[:, 1])
    camera = {key: getattr(CAMERA, key) for key in ("width_px", "height_px", "fx_px", "fy_px", "cx_px", "cy_px")}
    task = {"camera": camera, "pose": POSE, "lenses": LENSES, "runs": runs}
    (folder / "task.json").write_text(json.dumps(task | {"height_poses": [terms for terms, _, _ in scenes]}))


def main(arguments: list[str] | None = None) -> None:
    """Print both times, their ratio, how far the answers are apart, and the table of heights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pixels", type=int, default=1_000_000)
    parser.add_argument("--turns", type=int, default=4, help="of both; the best counts, of each")
    parser.add_argument("--runs", type=int, default=7, help="in a turn")
    parser.add_argument("--draws", type=int, default=500, help="of the pixels of each object")
    args = parser.parse_args(arguments)
    python = peer_python()
    pixels = np.random.default_rng(1).uniform([0, 0], [CAMERA.width_px, CAMERA.height_px], (args.pixels, 2))
    scenes = upright_objects(args.draws)
    cameras = {lens: camera_with(radial) for lens, radial in LENSES.items()}
    ours_s, theirs_s = dict.fromkeys(LENSES, math.inf), dict.fromkeys(LENSES, math.inf)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_task(folder, pixels, scenes, args.runs)
        for _ in range(args.turns):
            subprocess.run([python, HERE / "peer_cameratransform.py", folder], check=True)
            answer = json.loads((folder / "answer.json").read_text())
            for lens, camera in cameras.items():
                work = partial(ad.ground_points, camera, CAMERA_POSE, pixels)
                ours_s[lens] = min(ours_s[lens], best_s(work, args.runs))
                theirs_s[lens] = min(theirs_s[lens], answer["times_s"][lens])
        print(", ".join(f"{package} {version}" for package, version in answer["versions"].items()))
        for lens, camera in cameras.items():
            print(
                f"{len(pixels)} pixels to ground, {lens}: aerodft {ours_s[lens] * 1e3:.2f} ms, CameraTransform"
                f" {theirs_s[lens] * 1e3:.1f} ms, {theirs_s[lens] / ours_s[lens]:.0f} times as long"
            )
            print_difference(camera, pixels, np.load(folder / f"{lens}.npy")[:, :2])
        print_heights(scenes, [np.load(folder / f"heights{index}.npy") for index in range(len(scenes))])


def camera_with(radial: tuple[float, float, float]) -> Camera:
    """The camera with radial distortion."""
    k1, k2, k3 = radial
    return replace(CAMERA, distortion=(k1, k2, 0.0, 0.0, k3) if any(radial) else ())


def print_difference(camera: Camera, pixels: np.ndarray, theirs: np.ndarray) -> None:
    """How far the answers are apart, and how far from their pixels they are seen again."""
    right, ahead, _ = ad.ground_points(camera, CAMERA_POSE, pixels).T
    sin, cos = math.sin(math.radians(POSE["heading_deg"])), math.cos(math.radians(POSE["heading_deg"]))
    east_north = np.column_stack([cos * right + sin * ahead, cos * ahead - sin * right])
    answers = {"aerodft": east_north, "CameraTransform": theirs}
    print(f"  at most {np.nanmax(np.linalg.norm(answers['aerodft'] - theirs, axis=-1)):.1e} m apart")
    for name, points in answers.items():
        again = seen_at(camera, pose_of(POSE), np.column_stack([points, np.zeros(len(points))]))
        missed = np.count_nonzero(np.isnan(points[:, 0]))
        print(f"  {name}: {missed} missed, others seen again within {np.nanmax(np.abs(again - pixels)):.1e} px")


def print_heights(scenes: list, theirs: list[np.ndarray]) -> None:
    """The table: of exact pixels, then the root mean square error of pixels that are picked badly."""
    print(
        f"an upright object of {OBJECT_M:g} m, {AWAY_M:g} m away, seen from 20 m at tilt 70 deg; rms: {STD_PX:g} px off"
    )
    print("heading  aside  column | aerodft         rms m | CameraTransform  rms m  no answer")
    for (heading_deg, aside_deg), (_, pose, pairs), peer in zip(SCENES, scenes, theirs, strict=True):
        ours, std_m = heights(pose, pairs)
        rms = [math.sqrt(np.nanmean((found[1:] - OBJECT_M) ** 2)) for found in (ours, peer)]
        print(
            f"{heading_deg:7g} {aside_deg:6g} {pairs[0, 0, 0]:7.0f} | {ours[0]:.3f} +- {std_m:.3f} {rms[0]:6.3f} |"
            f" {peer[0]:15.3f} {rms[1]:6.3f} {np.mean(np.isnan(peer[1:])):10.0%}"
        )


if __name__ == "__main__":
    main()
