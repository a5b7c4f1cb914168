"""River widths of one image, and where the time goes: ``python tests/bench/bench_river.py [--width W]``."""

import argparse
import cProfile
import math
import pstats
import sys
import time
from pathlib import Path

import cv2

sys.path.insert(0, str(Path(__file__).parents[2]))

from aerodft.dft import Setup
from aerodft.geometry import camera_pose
from aerodft.model import PoseStd
from aerodft.sim import default_camera
from aerodft.sim.world import River as SimulatedRiver
from aerodft.sim.world import furnished_world
from aerodft.vision.river import River, RiverQuestion, find_river
from tests.waterside import Waterside, WatersideRenderer

PARTS = {
    "network": ("network.py", "looks"),
    "bank lines": ("bank_lines.py", "bank_lines"),
    "centreline": ("centreline.py", "centreline"),
    "transects": ("centreline.py", "transects"),
    "banks": ("banks.py", "locate_banks"),
    "islands": ("banks.py", "islands_across"),
    "widths": ("river.py", "river_widths"),
}


def main(arguments: list[str] | None = None) -> None:
    """Print images a second on one core, and the share of each part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=int, default=1920, help="of the image, px; 16:9")
    parser.add_argument("--runs", type=int, default=7, help="the best counts")
    args = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    camera = default_camera(args.width, args.width * 9 // 16)
    world = furnished_world(SimulatedRiver(azimuth_rad=0.0))
    std = PoseStd(height_agl_m=0.4, tilt_rad=5e-3, pan_rad=5e-3, roll_rad=5e-3)
    pose = camera_pose(height_agl_m=40.0, tilt_rad=math.radians(45.0), north_m=-30.0, std=std)
    look = Waterside(waves=0.15, mirror=0.05, foam=0.03, shade_m=2.0, growth=1.6)
    image = WatersideRenderer(camera, world, waterside=look).render(pose, 1.0)
    setup, question = Setup(camera=camera), RiverQuestion()
    found = find_river(image, setup, pose, question)
    if not isinstance(found, River):
        raise SystemExit(f"no river: {found.reason}")
    wall, processor = math.inf, math.inf
    for _ in range(args.runs):
        start, start_cpu = time.perf_counter(), time.process_time()
        find_river(image, setup, pose, question)
        wall = min(wall, time.perf_counter() - start)
        processor = min(processor, time.process_time() - start_cpu)
    print(
        f"river {camera.width_px} x {camera.height_px}: {1 / processor:.2f} images/s of one core ({processor:.3f} s of"
        f" processor, {wall:.3f} s by the clock), {len(found.rows)} widths in each"
    )
    profile = cProfile.Profile()
    profile.runcall(find_river, image, setup, pose, question)
    stats = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    total = max(row[3] for row in stats.values())
    spent = {(Path(file).name, name): row[3] for (file, _, name), row in stats.items()}
    shares = {part: spent.get(function, 0.0) / total for part, function in PARTS.items()}
    print("where the time goes: " + ", ".join(f"{part} {100 * share:.0f} %" for part, share in shares.items()))


if __name__ == "__main__":
    main()
