"""CameraTransform's side of ``bench_cameratransform``: run by it, with the python of the peer's own environment.

``python peer_cameratransform.py FOLDER``: reads ``task.json`` and the pixels there, writes ``answer.json`` and arrays.
Its camera axes are x right, y up, z backwards; its tilt is from straight down and its heading clockwise from north, as
here; its roll is the opposite. The principal point is given: its default is half a pixel from the image's centre in
coordinates that count pixel centres.
"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

import cameratransform
import numpy as np


def camera_of(camera: dict, pose: dict, radial: list) -> cameratransform.Camera:
    """The same camera, in its terms."""
    projection = cameratransform.RectilinearProjection(
        focallength_x_px=camera["fx_px"],
        focallength_y_px=camera["fy_px"],
        center=(camera["cx_px"], camera["cy_px"]),
        image=(camera["width_px"], camera["height_px"]),
    )
    orientation = cameratransform.SpatialOrientation(
        elevation_m=pose["height_agl_m"],
        tilt_deg=pose["tilt_deg"],
        roll_deg=-pose["roll_deg"],
        heading_deg=pose["heading_deg"],
    )
    lens = cameratransform.BrownLensDistortion(*radial) if any(radial) else None
    return cameratransform.Camera(projection, orientation, lens)


def main(folder: Path) -> None:
    """Ground points of the pixels, how long they take, and heights of upright objects."""
    task = json.loads((folder / "task.json").read_text())
    pixels = np.load(folder / "pixels.npy")
    times_s = {}
    for name, radial in task["lenses"].items():
        camera = camera_of(task["camera"], task["pose"], radial)
        best_s = np.inf
        for _ in range(task["runs"]):
            start_s = time.process_time()
            points = camera.spaceFromImage(pixels, Z=0)
            best_s = min(best_s, time.process_time() - start_s)
        times_s[name] = best_s
        np.save(folder / f"{name}.npy", points)
    for index, pose in enumerate(task["height_poses"]):
        camera = camera_of(task["camera"], pose, [])
        feet, heads = np.load(folder / f"feet{index}.npy"), np.load(folder / f"heads{index}.npy")
        with np.errstate(all="ignore"):
            np.save(folder / f"heights{index}.npy", camera.getObjectHeight(feet, heads))
    versions = {name: version(name) for name in ("cameratransform", "numpy")}
    (folder / "answer.json").write_text(json.dumps({"times_s": times_s, "versions": versions}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
