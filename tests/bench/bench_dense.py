"""Whole images and many pixels to ground, beside a plain copy: ``python tests/bench/bench_dense.py [--width W]``."""

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from aerodft.dft.maps import GroundMap, depth_map
from aerodft.geometry import camera_pose
from aerodft.model import Camera, Pose

SINGLES = 5000


def _best_s(runs: int, *works: Callable[[], object]) -> list[float]:
    """The shortest time of each, taken in turns so that what else runs meets them alike."""
    best = [math.inf] * len(works)
    for _ in range(runs):
        for index, work in enumerate(works):
            start_s = time.process_time()
            work()
            best[index] = min(best[index], time.process_time() - start_s)
    return best


def main(arguments: list[str] | None = None) -> None:
    """Print the depth map's speed as a share of a copy's, millions of pixels per second, and the time of one pixel."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=int, default=3840, help="of the image, px; 16:9")
    parser.add_argument("--pixels", type=int, default=1_000_000, help="to ground at once")
    parser.add_argument("--runs", type=int, default=15, help="of each; the best counts")
    args = parser.parse_args(arguments)
    fov_rad = {"hfov_rad": math.radians(70.0), "vfov_rad": math.radians(43.0)}
    plain = Camera.from_fov(name="straight", width_px=args.width, height_px=args.width * 9 // 16, **fov_rad)
    bent = replace(plain, name="bent", distortion=(-0.1, 0.02, 0.0005, -0.0003, 0.0))
    pose = camera_pose(height_agl_m=50.0, tilt_rad=1.2, roll_rad=0.05, heading_rad=0.7)

    for camera in (plain, bent):
        start_s = time.process_time()
        out = depth_map(camera, pose).planes
        first_s = time.process_time() - start_s
        copy = np.empty_like(out)
        map_s, copy_s = _best_s(
            args.runs,
            lambda camera=camera, out=out: depth_map(camera, pose, out=out),
            lambda copy=copy, out=out: np.copyto(copy, out),
        )
        print(
            f"dense {plain.width_px} x {plain.height_px}, {camera.name}: {map_s * 1e3:.1f} ms, {copy_s / map_s:.0%} of"
            f" the speed of a copy of its four arrays; with the rays, the first time, {first_s:.2f} s"
        )

    pixels = np.random.default_rng(1).uniform(0, plain.height_px, (args.pixels, 2))
    for camera in (plain, bent):
        _to_ground(camera, pose, pixels, args.runs)


def _to_ground(camera: Camera, pose: Pose, pixels: np.ndarray, runs: int) -> None:
    ground = GroundMap.at(camera, pose)
    ground.points_enu_m(pixels[:300])
    many_s, copy_s = _best_s(runs, lambda: ground.points_enu_m(pixels), pixels.copy)
    singles = list(pixels[:SINGLES])  # no pixel twice
    one_s = min(_each_s(ground.points_enu_m, singles) for _ in range(5))
    print(
        f"pixels to ground, {camera.name}: {len(pixels) / many_s / 1e6:.1f} million/s,"
        f" {many_s / copy_s:.1f} times as long as a copy; one with a known pose {one_s * 1e6:.1f} us"
    )


def _each_s(work: Callable[[np.ndarray], object], pixels: list[np.ndarray]) -> float:
    start_s = time.process_time()
    for pixel in pixels:
        work(pixel)
    return (time.process_time() - start_s) / len(pixels)


if __name__ == "__main__":
    main()
