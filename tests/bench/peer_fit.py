"""CameraTransform's side of ``bench_calibration``: run by it, with the python of the peer's own environment.

``python peer_fit.py FOLDER``: reads ``task.json`` and the landmarks there, writes ``answer.json``. Its roll is the
opposite of ours; landmarks are stated with a standard deviation of 0.1 m, for it takes none in pixels.
"""

import json
import sys
import time
from pathlib import Path

import cameratransform
import numpy as np

STD_M = 0.1
BOUNDS = {"elevation_m": (0.1, 1000.0), "tilt_deg": (0.0, 180.0), "roll_deg": (-180.0, 180.0)}


def main(folder: Path) -> None:
    """The shortest processor time of a fit, and what it found."""
    task = json.loads((folder / "task.json").read_text())
    camera = cameratransform.Camera(
        cameratransform.RectilinearProjection(
            focallength_px=task["focal_px"], center=tuple(task["centre"]), image=tuple(task["size"])
        ),
        cameratransform.SpatialOrientation(roll_deg=0.0, heading_deg=0.0),
    )
    camera.addLandmarkInformation(
        np.load(folder / "pixels.npy"), np.load(folder / "points.npy"), np.array([STD_M, STD_M, STD_M])
    )
    best_s = np.inf
    for _ in range(task["runs"]):
        unknowns = [
            cameratransform.FitParameter(name, lower=lower, upper=upper, value=value)
            for name, value in task["start"].items()
            for lower, upper in [BOUNDS.get(name, (-180.0, 360.0))]
        ]
        start_s = time.process_time()
        found = camera.fit(unknowns)
        best_s = min(best_s, time.process_time() - start_s)
    values = [-value if name == "roll_deg" else value for name, value in zip(task["start"], found.x, strict=True)]
    (folder / "answer.json").write_text(json.dumps({"time_s": best_s, "found": values}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
