"""Rays to rough ground, all of an image and one at a time: ``python tests/bench/bench_terrain.py [--cells N]``."""

import argparse
import math
import time

import numpy as np

from aerodft.geometry import ElevationGrid, Terrain, camera_attitude, jacobians, matrix, meet_level, rays_from_pixels
from aerodft.model import CODE_OF, Camera, Status

CAMERA_ENU_M = np.array([0.0, 0.0, 120.0])
SINGLES = 200


def _rough(cells: int, cell_m: float) -> ElevationGrid:
    """Waves of all lengths, up to 30 m high, the longer the higher."""
    rng = np.random.default_rng(5)
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(cells + 1), np.fft.fftfreq(cells + 1)))
    spectrum = np.fft.fft2(rng.normal(size=frequency.shape)) / np.where(frequency > 0, frequency, np.inf) ** 1.8
    heights = np.real(np.fft.ifft2(spectrum))
    corner_m = -cells * cell_m / 2
    return ElevationGrid(
        east_m=corner_m, north_m=corner_m, cell_m=cell_m, heights_m=heights * 30.0 / np.max(np.abs(heights))
    )


def _rays(camera: Camera, tilt_deg: float, step_px: int) -> np.ndarray:
    u, v = np.meshgrid(np.arange(0, camera.width_px, step_px), np.arange(0, camera.height_px, step_px))
    rays_cam = rays_from_pixels(camera, np.stack([u, v], axis=-1).astype(float))
    return rays_cam @ matrix(camera_attitude(math.radians(tilt_deg), 0.0, 0.7)).T


def main(arguments: list[str] | None = None) -> None:
    """Print rays per second for several tilts, and the time of one ray."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cells", type=int, default=2000, help="on the grid's side, 2 m each")
    parser.add_argument("--step", type=int, default=2, help="every n-th pixel of 1920 x 1080")
    args = parser.parse_args(arguments)
    hfov_rad, vfov_rad = math.radians(70.0), math.radians(43.0)
    camera = Camera.from_fov(name="bench", width_px=1920, height_px=1080, hfov_rad=hfov_rad, vfov_rad=vfov_rad)
    ground = Terrain(_rough(args.cells, 2.0), 0.0)
    for tilt_deg in (0.0, 45.0, 70.0, 85.0):
        rays = _rays(camera, tilt_deg, args.step)
        ground.meet(CAMERA_ENU_M, rays[:1], 0.0)
        start_s = time.perf_counter()
        hits = ground.meet(CAMERA_ENU_M, rays, 0.0)
        took_s = time.perf_counter() - start_s
        share, count = np.mean(hits.status == CODE_OF[Status.OK]), hits.status.size
        flat_s = time.perf_counter()
        meet_level(CAMERA_ENU_M, rays, 0.0)
        flat_s = time.perf_counter() - flat_s
        print(
            f"tilt {tilt_deg:2.0f}: {count / took_s / 1e6:.2f} million rays/s, {share:.0%} hit, "
            f"{took_s / flat_s:.1f} times as long as flat ground"
        )
    ray = rays[-1, 0]
    start_s = time.perf_counter()
    for _ in range(SINGLES):
        jacobians(CAMERA_ENU_M, ray, ground.meet(CAMERA_ENU_M, ray, 0.0))
    print(f"one ray with its derivatives: {(time.perf_counter() - start_s) / SINGLES * 1e6:.0f} us")


if __name__ == "__main__":
    main()
