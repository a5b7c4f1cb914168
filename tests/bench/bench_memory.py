"""Peak memory of each command that reads recordings, and its start: ``python tests/bench/bench_memory.py``.

The recordings are of a sample flight, and of six minutes of it: ours, another tool's, and damaged ones; logs are of 60
MB. Goal: 500 MB.
"""

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from tests.faults.test_memory import attitudes  # noqa: E402 - found from the line above
from tests.peak import taken_by  # noqa: E402 - as above
from tests.replay.foreign_files import frames_of, jpegs, write_foreign  # noqa: E402 - as above

LOG = ROOT / "samples/copter.tlog"
GOAL_MB = 500.0
PICTURES, WIDTH_PX, HEIGHT_PX = 60, 1920, 1080
LONG, LARGE_PICTURES, MANY_PICTURES, LOG_BYTES = 6, 150, 8000, 60_000_000
FOREIGN_STATION = """
[station]
name = "bench"
[camera]
file = "camera.toml"
[telemetry.height]
order = ["home"]
[[probe]]
name = "across"
kind = "width"
pixels = [[600, 700], [1300, 720]]
[[probe]]
name = "centre"
kind = "position"
pixels = [[960, 540]]
"""
CAMERA = f'name = "bench"\nwidth_px = {WIDTH_PX}\nheight_px = {HEIGHT_PX}\nhfov_deg = 62.2\n'


def files(folder: Path) -> tuple[Path, Path]:
    """A station's configuration and another tool's recording."""
    (folder / "camera.toml").write_text(CAMERA)
    config = folder / "station.toml"
    config.write_text(FOREIGN_STATION)
    frames = frames_of(LOG)
    step_ns = (frames[-1][0] - frames[0][0]) // (PICTURES + 1)
    stamps_ns = [frames[0][0] + (k + 1) * step_ns for k in range(PICTURES)]
    return config, write_foreign(folder / "foreign.mcap", frames, jpegs(stamps_ns, WIDTH_PX, HEIGHT_PX))


def long_files(folder: Path) -> dict[str, Path]:
    """Six minutes of another tool's: telemetry alone, with images of 1.7 MB, and with images at 22 Hz."""
    frames = frames_of(LOG)
    span_ns = frames[-1][0] - frames[0][0] + 10**9
    long = [(at_ns + turn * span_ns, data) for turn in range(LONG) for at_ns, data in frames]
    noise = np.random.default_rng(5).integers(0, 255, (HEIGHT_PX, WIDTH_PX, 3), dtype=np.uint8)
    jpeg = cv2.imencode(".jpg", cv2.GaussianBlur(noise, (0, 0), 0.8), [cv2.IMWRITE_JPEG_QUALITY, 96])[1].tobytes()

    def stamps_ns(count: int) -> list[int]:
        step_ns = (long[-1][0] - long[0][0]) // (count + 1)
        return [long[0][0] + (k + 1) * step_ns for k in range(count)]

    finest = cv2.imencode(".jpg", noise, [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    pictures = {
        "long": [],
        "large": [(stamp_ns, jpeg) for stamp_ns in stamps_ns(LARGE_PICTURES)],
        "larger": [(stamp_ns, finest) for stamp_ns in stamps_ns(LARGE_PICTURES)],
        "many": jpegs(stamps_ns(MANY_PICTURES), WIDTH_PX, HEIGHT_PX),
    }
    return {name: write_foreign(folder / f"{name}.mcap", long, each) for name, each in pictures.items()}


def commands(folder: Path) -> dict[str, list[object]]:
    """Arguments of each command, in an order in which they can be run."""
    config, foreign = files(folder)
    long = long_files(folder)
    ours, again = folder / "ours", folder / "again"
    cut, flipped = folder / "cut.mcap", folder / "flipped.mcap"
    data = bytearray(foreign.read_bytes())
    cut.write_bytes(data[: len(data) * 2 // 3])
    data[len(data) // 2] ^= 4
    flipped.write_bytes(data)
    tlog, binary = folder / "long.tlog", folder / "long.bin"
    tlog.write_bytes(LOG.read_bytes() * (LOG_BYTES // LOG.stat().st_size))
    binary.write_bytes(attitudes(LOG_BYTES // 31))
    bent = folder / "bent.toml"
    straight = f"fx_px = 1591.0\nfy_px = 1591.0\ncx_px = {(WIDTH_PX - 1) / 2}\ncy_px = {(HEIGHT_PX - 1) / 2}"
    bends = f"{straight}\ndistortion = [-0.1, 0.02, 0.001, -0.001, 0.0]"
    (folder / "bent-camera.toml").write_text(CAMERA.replace("hfov_deg = 62.2", bends))
    bent.write_text(FOREIGN_STATION.replace("camera.toml", "bent-camera.toml"))
    apart, wide = folder / "apart.toml", folder / "wide.toml"
    apart.write_text(f"[images]\ntime_offset_s = 86400.0\n{FOREIGN_STATION}")
    (folder / "wide-camera.toml").write_text(CAMERA.replace(f"width_px = {WIDTH_PX}", f"width_px = {WIDTH_PX + 2}"))
    wide.write_text(FOREIGN_STATION.replace("camera.toml", "wide-camera.toml"))
    quiet: list[object] = ["--rate", "max", "--listen", "tcp/127.0.0.1:0"]
    reading: dict[str, list[object]] = {
        "replay": ["replay", ours, *quiet],
        "replay, other tool": ["replay", foreign, *quiet],
        "replay, cut": ["replay", cut, *quiet],
        "replay, flipped": ["replay", flipped, *quiet],
        "doctor, other tool": ["doctor", foreign],
        "doctor, six minutes": ["doctor", long["long"]],
        "doctor, large images": ["doctor", long["large"]],
        "doctor, .tlog": ["doctor", LOG],
        "doctor, .tlog of 60 MB": ["doctor", tlog],
        "doctor, .bin of 60 MB": ["doctor", binary],
        "import, no overlap": ["import", foreign, "-c", apart, "-o", folder / "none"],
        "import, wrong size": ["import", foreign, "-c", wide, "-o", folder / "none"],
        "recover": ["recover", ours],
        "compare": ["compare", ours, again],
        "compare, plot": ["compare", ours, again, "-o", folder / "plot.png"],
        "export, CSV": ["export", ours, "--format", "csv", "-o", folder / "ours.csv"],
        "export, MCAP": ["export", ours, "--format", "mcap", "-o", folder / "ours.mcap"],
        "export, Parquet": ["export", ours, "--format", "parquet", "-o", folder / "ours.parquet"],
        "no recording": ["replay", config],
        "measure --help": ["measure", "--help"],
        "--help": ["--help"],
    }
    return {
        "import, other tool": ["import", foreign, "-c", config, "-o", ours],
        "import, cut": ["import", cut, "-c", config, "-o", folder / "of-cut"],
        **{
            f"import, {what}": ["import", long[name], "-c", config, "-o", folder / f"of-{name}"]
            for name, what in (
                ("long", "six minutes"),
                ("large", "150 of 1.7 MB"),
                ("larger", "150 of 4.1 MB"),
                ("many", "8000 images"),
            )
        },
        "import, bent lens": ["import", foreign, "-c", bent, "-o", folder / "of-bent"],
        "recompute": ["recompute", ours, "-o", again],
        "export, 1080p video": ["export", ours, "--format", "mp4", "-o", folder / "ours.mp4"],
        "export, video of large": ["export", folder / "of-large", "--format", "mp4", "-o", folder / "large.mp4"],
        **reading,
    }


def main() -> None:
    """Print a line for each command."""
    with tempfile.TemporaryDirectory() as name:
        for title, line in commands(Path(name)).items():
            taken = taken_by(*line, timeout_s=300)
            verdict = "within" if taken.peak_mb < GOAL_MB else "BEYOND"
            print(
                f"{title:22} {taken.peak_mb:4.0f} MB, {verdict} {GOAL_MB:g} MB; {taken.cpu_s:.2f} s of processor;"
                f" exit code {taken.code}",
                flush=True,
            )


if __name__ == "__main__":
    main()
