"""Images per second of tracked probes and of moving objects: ``python tests/bench/bench_tracked.py [--images 60]``.

1080p images of simulated scenes, in memory; decoding a video comes on top. One thread; processor time.
"""

import argparse
import math
import time
from collections import Counter
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from aerodft.conventions import SECOND_NS
from aerodft.geometry import camera_pose
from aerodft.model import Image, PixelSource, PoseSample, Probe, ProbeKind, Status
from aerodft.service import ObjectSettings
from aerodft.sim import default_camera
from aerodft.sim.render import Renderer, SensorModel
from aerodft.sim.trajectory import survey
from aerodft.sim.world import DEFAULT_ORIGIN, River, furnished_world
from aerodft.sim.yard import YARD, yard_flight
from aerodft.vision import plane_lock
from aerodft.vision.common import tracking
from aerodft.vision.objects import moving

CAMERA = default_camera(1920, 1080)
_spent: Counter[str] = Counter()


def timed(owner: Any, name: str, label: str) -> None:
    """Have a function's processor time counted."""
    inner = getattr(owner, name)

    def outer(*args: Any, **kwargs: Any) -> Any:
        start = time.process_time()
        try:
            return inner(*args, **kwargs)
        finally:
            _spent[label] += time.process_time() - start

    setattr(owner, name, outer)


def report(what: str, images: int, total_s: float) -> None:
    parts = ", ".join(f"{label} {1000 * spent / images:.1f} ms" for label, spent in _spent.most_common())
    print(f"{what}: {images / total_s:.1f} images/s, {1000 * total_s / images:.1f} ms an image: {parts}")
    _spent.clear()


def bench_tracked(count: int) -> None:
    river = River(origin_en_m=(0.0, -25.0))
    flight = survey(river, origin=DEFAULT_ORIGIN, duration_s=60.0)
    renderer = Renderer(CAMERA, furnished_world(river), SensorModel())
    stamps = [flight.start_ns + 21 * SECOND_NS + k * SECOND_NS // 30 for k in range(count + 1)]
    poses = [flight.pose(stamp) for stamp in stamps]
    frames = [renderer.render(pose, 21 + k / 30) for k, pose in enumerate(poses)]
    pixels = ((800.0, 520.0), (1150.0, 560.0))
    probe = Probe(name="banks", kind=ProbeKind.DISTANCE, source=PixelSource.TRACKED, pixels=pixels)
    samples = [PoseSample(stamp_ns=s, status=Status.OK, pose=p) for s, p in zip(stamps, poses, strict=True)]
    observer = plane_lock.TrackedProbes(CAMERA, (probe,), lambda image: samples[image.index], None)
    images = [
        Image(index=k, stamp_ns=stamps[k], arrival_ns=stamps[k], pixels=lambda k=k: frames[k]) for k in range(count + 1)
    ]
    observer.observe(images[0])
    start, lost = time.process_time(), 0
    for image in images[1:]:
        lost += not observer.observe(image)[0].pixels
    report(f"tracked probes, 1080p, lost in {lost} of {count}", count, time.process_time() - start)


def bench_moving(count: int) -> None:
    pose = camera_pose(height_agl_m=5.0, tilt_rad=math.radians(68), roll_rad=math.radians(4))
    empty, full = Renderer(CAMERA, replace(YARD, walkers=()), SensorModel()), Renderer(CAMERA, YARD, SensorModel())
    observer = moving.MovingObjects(CAMERA, ObjectSettings())
    for k in range(10):
        observer.outlines(empty.render(pose, k / 10))
    _spent.clear()
    frames = [full.render(pose, 1 + k / 10) for k in range(count)]
    start = time.process_time()
    found = [len(observer.outlines(frame)) for frame in frames]
    report(f"moving objects, 1080p, {np.median(found):.0f} in an image", count, time.process_time() - start)


def bench_from_above(count: int) -> None:
    flight = yard_flight(seconds=(count + 12) / 10, width_px=1920)
    images = list(flight.images())
    poses = {stamp: flight.trajectory.pose(stamp) for stamp, _ in images}

    def pose_of(image: Image) -> PoseSample:
        return PoseSample(stamp_ns=image.stamp_ns, status=Status.OK, pose=poses[image.stamp_ns])

    observer, found, start = moving.MovingOverGround(CAMERA, ObjectSettings(), pose_of), [], 0.0
    for k, (stamp_ns, pixels) in enumerate(images):
        if k == len(images) - count:
            _spent.clear()
            start = time.process_time()
        image = Image(index=k, stamp_ns=stamp_ns, arrival_ns=stamp_ns, pixels=lambda pixels=pixels: pixels)
        found.append(sum(bool(each.contour) for each in observer.observe(image)))
    report(
        f"moving objects from a drone, 1080p, {np.median(found):.0f} in an image", count, time.process_time() - start
    )


def main(arguments: list[str] | None = None) -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=60)
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    timed(tracking.UndistortedView, "small", "making it small and grey")
    timed(tracking.UndistortedView, "warp", "warping the keyframe")
    timed(plane_lock, "track_lk", "Lucas-Kanade there and back")
    timed(plane_lock, "groups_of", "homographies")
    timed(moving, "shadows", "shadows")
    timed(moving, "outlines_of", "outlines")
    timed(moving, "_whole", "cleaning the mask")
    timed(moving.GroundBackground, "new_in", "what is new on the ground")
    timed(moving.GroundBackground, "learn", "learning the ground")
    timed(moving.GroundCanvas, "warp", "warping it onto the ground")
    bench_tracked(options.images)
    bench_moving(options.images)
    bench_from_above(options.images)


if __name__ == "__main__":
    main()
