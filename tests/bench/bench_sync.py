"""How well ``aerodft sync`` finds clocks and lag: ``python tests/bench/bench_sync.py [--seeds 20]``.

Each flight is rendered, its video stamped by a clock of its own (offset up to 20 s, drift up to 2 %), its gimbal up to
0.3 s behind its reports, which are noisy and biased; half of them are surveys of the river, half wander about.
"""

import argparse
import runpy
import tempfile
import time
from pathlib import Path

import numpy as np
import tomli_w

from aerodft.adapters.config.camera import camera_document
from aerodft.app.align import align
from aerodft.errors import NoAnswerError
from calibration.sync import Alignment

HERE = Path(__file__).parent
SIGMAS_95 = 1.96
MOST_S, MOST_DRIFT = 0.02, 5e-4
NAMES = ("offset", "drift", "lag", "offset less lag")


def aligned(seed: int, folder: Path, seconds: float, size: tuple[int, int]) -> tuple[Alignment, np.ndarray, float]:
    """The alignment of one flight, the true offset, drift and lag, and the processor time of finding it."""
    flights = runpy.run_path(str(HERE.parent / "calibration" / "sync_flights.py"))
    clocks = flights["Clocks"].drawn(seed)
    trajectory, margin_s = flights["flight"](seed, seconds)
    filmed = flights["scenario"](trajectory, seed, clocks, margin_s=margin_s, size=size)
    flights["write_log"](filmed, folder / "flight.tlog")
    (folder / "camera.toml").write_text(tomli_w.dumps(camera_document(filmed.camera)))
    reference_ns = flights["write_clip"](filmed, clocks, folder / "video.mp4")
    start_s = time.process_time()
    camera = folder / "camera.toml"
    found = align(folder / "video.mp4", folder / "flight.tlog", camera=camera, max_offset_s=20.5).solution
    offset_s = clocks.offset_s + clocks.drift * (found.reference_ns - reference_ns) / 1e9
    return found, np.array([offset_s, clocks.drift, clocks.lag_s]), time.process_time() - start_s


def main(arguments: list[str] | None = None) -> None:
    """Print every flight's errors, then how many keep the bounds and how many truths lie in their intervals."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--width", type=int, default=640)
    options = parser.parse_args(arguments)
    size = options.width, options.width * 9 // 16
    kept, inside = 0, np.zeros(len(NAMES), dtype=int)
    for seed in range(options.first, options.first + options.seeds):
        try:
            with tempfile.TemporaryDirectory() as name:
                found, truth, cpu_s = aligned(seed, Path(name), options.seconds, size)
        except NoAnswerError as error:
            print(f"{seed}: {error}")
            continue
        off = np.array([found.offset_s, found.drift, found.lag_s]) - truth
        stds = np.append(found.stds, found.attitude_std_s())
        errors = np.append(off, off[0] - off[2])
        kept += bool(abs(errors[3]) < MOST_S and abs(off[0] + off[2]) < MOST_S and abs(off[1]) < MOST_DRIFT)
        inside += np.abs(errors) < SIGMAS_95 * stds
        print(
            f"{seed}: offset {1e3 * off[0]:+.1f} ms, lag {1e3 * off[2]:+.1f} ms, drift {100 * off[1]:+.4f} % off;"
            f" stds {1e3 * stds[0]:.1f} ms, {1e3 * stds[2]:.1f} ms, {100 * stds[1]:.4f} %; {cpu_s:.1f} s of one core"
        )
    print(f"{kept} of {options.seeds} within {1e3 * MOST_S:.0f} ms and {100 * MOST_DRIFT} %")
    print("in their 95 % intervals: " + ", ".join(f"{name} {n}" for name, n in zip(NAMES, inside, strict=True)))


if __name__ == "__main__":
    main()
