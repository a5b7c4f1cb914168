"""``aerodft demo``: simulator, service, subscriber, replay and recompute as real processes, and what came of it.

These end with it, also where it is killed: their standard input ends then. ``python -m aerodft.cli.demo -m MODULE
ARGUMENTS`` runs a module so, with a pipe that only the demo holds the other end of; ``... listen ENDPOINT STATION
FILE`` writes a station's measurements from the bus as JSON lines.
"""

import logging
import os
import runpy
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import tomli_w
import typer
from rich.table import Table

from aerodft.adapters.files import check_is_local
from aerodft.cli.interrupts import end_if_signalled
from aerodft.cli.options import JsonOption
from aerodft.cli.output import print_json, say, tables
from aerodft.errors import AerodftError, InputError, os_errors_as

_log = logging.getLogger(__name__)

_MARK = ".aerodft-demo"
_STATION = "demo"
_STDS = {"height_m": 0.3, "tilt_deg": 0.3, "roll_deg": 0.2, "heading_deg": 1.0}
_STALL_S: Final = 60.0  # without movement; beside 40 busy processes on two cores a process still gets 3 s of these
_MIN_CPU_S: Final = 0.3  # that count as movement: idle threads that wake now and then take 0.01 s a minute
_SAY_EVERY_S: Final = 10.0
_LOOK_S: Final = 0.05
_ENDING_S: Final = 5.0
_CLOCK_TICKS: Final = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True)
class _Ports:
    mavlink: int
    video: int
    bus: int

    @property
    def endpoint(self) -> str:
        return f"tcp/127.0.0.1:{self.bus}"


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for everything that comes of it.")] = Path(
        "demo"
    ),
    duration: Annotated[float, typer.Option(help="Length of the flight, s.", min=5.0, max=600.0)] = 12.0,
    seed: Annotated[int, typer.Option(help="Of everything random.", min=0)] = 7,
    json: JsonOption = False,
) -> None:
    r"""Fly a simulated flight through everything: simulator, UDP, service, zenoh, MCAP, replay, recompute.

    \b
    Example:
      aerodft demo --output demo
    """
    from aerodft.reports.demo import report_demo
    from replay.compare import compare_measurements
    from replay.recordings import Recording

    began = time.monotonic()
    _clear(output)
    ports = _free_ports()
    _write_config(output, ports)
    _fly(output, ports, duration, seed)
    live = output / "recording"
    say("replaying the recording on the bus, and recomputing it from its raw input ...")
    replayed = _replay(output, live)
    _command("recompute", live, "-o", output / "recomputed")
    comparison = compare_measurements(live, output / "recomputed")
    probes = report_demo(output / "flight", Recording(live), output)
    _print_table(probes)
    received = _lines(output / "received.jsonl")
    say(f"a subscriber in another process received {len(received)} of {comparison.total.paired} measurements live,")
    same = "the same bytes" if replayed == received else "other bytes"
    say(f"{len(replayed)} when the recording was replayed: {same}.")
    verdict = "identical to the byte" if comparison.is_identical else "DIFFERENT"
    say(f"{comparison.total.paired} measurements recomputed from the raw recording: {verdict}.")
    spread = ", ".join(f"{name} {value:g}" for name, value in _STDS.items())
    say(f"one flight has one bias, drawn from these stds: {spread}; its intervals hold the truth or miss it together.")
    say(f"look at {output}/annotated.png and widths.png; measurements.csv and .geojson open anywhere,")
    say(f"{output}/recording in Foxglove. Done in {time.monotonic() - began:.0f} s.")
    say(f"to click widths of your own in its images: aerodft view {output}/recording --open")
    if json:
        print_json({"probes": probes, "identical": comparison.is_identical, "received": len(received)})
    if not comparison.is_identical:
        raise typer.Exit(5)


def _print_table(probes: dict[str, Any]) -> None:
    """Truth beside measurement, on stdout."""
    table = Table("probe", "truth", "measured", "95 % interval", "inside?", "hold the truth", title="One image each")
    for name, row in probes.items():
        low, high = row["ci95_m"]
        table.add_row(
            name,
            f"{row['truth_m']:.2f} m",
            f"{row['measured_m']:.2f} m",
            f"{low:.2f} ... {high:.2f} m",
            "yes" if row["inside"] else "no",
            f"{row['intervals_with_truth']} of {row['intervals']}",
        )
    tables().print(table)


def _clear(output: Path) -> None:
    check_is_local(output)
    if output.exists() and not (output / _MARK).exists() and any(output.iterdir() if output.is_dir() else [output]):
        raise InputError(
            "holds something that no demo made", where=output, expected="a new folder", hint="use --output"
        )
    shutil.rmtree(output, ignore_errors=True)
    with os_errors_as("cannot be written", where=output):
        output.mkdir(parents=True)
        (output / _MARK).touch()


def _free_ports() -> _Ports:
    """Three loopback ports that nobody uses at the moment."""
    with socket.socket(type=socket.SOCK_DGRAM) as a, socket.socket(type=socket.SOCK_DGRAM) as b, socket.socket() as c:
        for each in (a, b, c):
            each.bind(("127.0.0.1", 0))
        return _Ports(*(each.getsockname()[1] for each in (a, b, c)))


def _write_config(output: Path, ports: _Ports) -> None:
    from aerodft.adapters.config.camera import camera_document
    from aerodft.sim import default_camera

    (output / "camera.toml").write_text(tomli_w.dumps(camera_document(default_camera(1280, 720))), encoding="utf-8")
    widths = [{"name": f"width-{letter}", "kind": "distance", "observed": True} for letter in "abc"]
    document = {
        "station": {"name": _STATION},
        "camera": {"file": "camera.toml"},
        "telemetry": {
            "connection": f"udpin:127.0.0.1:{ports.mavlink}",
            "height": {"order": ["home"], "std_m": {"home": _STDS["height_m"]}},
            "attitude": {
                "tilt_std_deg": _STDS["tilt_deg"],
                "pan_std_deg": _STDS["tilt_deg"],
                "roll_std_deg": _STDS["roll_deg"],
                "heading_std_deg": _STDS["heading_deg"],
            },
        },
        "images": {"stream": f"udp://127.0.0.1:{ports.video}", "time_std_s": 0.01},
        "zenoh": {"listen": ports.endpoint},
        "record": {"image_hz": 2.0},
        "probe": [
            *widths,
            {"name": "river", "kind": "distance", "observed": True},
            {"name": "centre", "kind": "position", "pixels": [[639.5, 359.5]]},
        ],
    }
    (output / "station.toml").write_text(tomli_w.dumps(document), encoding="utf-8")


def _fly(output: Path, ports: _Ports, duration_s: float, seed: int) -> None:
    """Service, subscriber and simulator, until the flight is over."""
    stds = (
        f"height={_STDS['height_m']},tilt={_STDS['tilt_deg']},roll={_STDS['roll_deg']},heading={_STDS['heading_deg']}"
    )
    simulator = [
        *("-m", "aerodft.sim", "--out", output / "flight", "--duration", duration_s, "--seed", seed, "--live"),
        *("--camera", output / "camera.toml", "--fps", 8, "--std", stds, "--noise", "height=0.05,tilt=0.05"),
        *("--mavlink", f"udpout:127.0.0.1:{ports.mavlink}", "--video", f"udp://127.0.0.1:{ports.video}"),
        *("--zenoh", ports.endpoint, "--station", _STATION),
    ]
    service = ("-m", "aerodft", "serve", output / "station.toml", "-o", output / "recording")
    listener = ("-m", "aerodft.cli.demo", "listen", ports.endpoint, _STATION, output / "received.jsonl")
    with _process(output, "listener", listener):
        with _process(output, "serve", service) as serving:
            _wait_until_recording(output / "serve.log", serving)
            say("rendering the flight, then flying it: MAVLink and H.264 over UDP on loopback ...")
            with _process(output, "simulator", simulator) as flying:
                _wait(flying, output / "simulator.log", "the flight to end", lambda: flying.poll() is not None)
                if flying.returncode != 0:
                    raise _failure(output / "simulator.log", flying)
            time.sleep(1.0)  # what is under way arrives
        time.sleep(0.5)  # and what the service says as it ends


def _wait_until_recording(log: Path, service: subprocess.Popen[bytes]) -> None:
    """Wait for the service's word: after an installation its functions are compiled first."""

    def is_recording() -> bool:
        return any(line.startswith("recording to") for line in _lines(log))

    _wait(service, log, "the service to begin recording", lambda: service.poll() is not None or is_recording())
    if not is_recording():
        raise _failure(log, service)


def _wait(process: subprocess.Popen[bytes], log: Path, what: str, is_done: Callable[[], bool]) -> None:
    """Wait as long as a process moves: it writes to its log, or takes processor time.

    Args:
        process: The process.
        log: What it writes.
        what: What is waited for, for the sentence that is said every 10 s.
        is_done: Whether it has come.

    Raises:
        AerodftError: Nothing has moved for a minute.
    """
    began_s = said_s = moved_s = time.monotonic()
    size, cpu_s = -1, 0.0
    while not is_done():
        end_if_signalled()
        time.sleep(_LOOK_S)
        now_s, new_size, new_cpu_s = time.monotonic(), _size(log), _cpu_s(process.pid)
        if new_size != size or new_cpu_s is None or new_cpu_s - cpu_s >= _MIN_CPU_S:
            size, cpu_s, moved_s = new_size, new_cpu_s or 0.0, now_s
        if now_s - said_s >= _SAY_EVERY_S:
            said_s = now_s
            say(f"waiting for {what}, {now_s - began_s:.0f} s so far; its words go to {log}")
        if now_s - moved_s > _STALL_S:
            hint = "stop what else keeps this machine busy, then start the demo again"
            raise AerodftError(
                f"the demo waited for {what}, and nothing moved for {_STALL_S:.0f} s", where=log, hint=hint
            )


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _cpu_s(pid: int) -> float | None:
    """Processor time that a process and its threads have taken, s; None where the system does not tell it so."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    except OSError:
        return None
    return (int(fields[11]) + int(fields[12])) / _CLOCK_TICKS  # utime and stime; field 3 stands first behind the name


def _replay(output: Path, recording: Path) -> list[str]:
    """Publish the recording at full speed to a subscriber of its own; returns what that received."""
    endpoint = _free_ports().endpoint
    listener = ("-m", "aerodft.cli.demo", "listen", endpoint, _STATION, output / "replayed.jsonl")
    with _process(output, "replay-listener", listener):
        _command("replay", recording, "--rate", "max", "--listen", endpoint, "--wait", 20)
        time.sleep(0.5)  # what is under way arrives
    return _lines(output / "replayed.jsonl")


@contextmanager
def _process(
    output: Path, name: str, arguments: tuple[object, ...] | list[object]
) -> Iterator[subprocess.Popen[bytes]]:
    """A Python process of ours, its words in a log file; ended with SIGTERM, which all of them take as the end.

    It ends as well where this process is killed: the pipe to it is closed then.
    """
    with (output / f"{name}.log").open("wb") as log:
        process = subprocess.Popen(  # noqa: S603 - our own interpreter and modules
            [sys.executable, "-m", "aerodft.cli.demo", *map(str, arguments)],
            stdin=subprocess.PIPE,
            stdout=log,
            stderr=log,
        )
        try:
            yield process
            if process.poll() not in {None, 0}:
                raise _failure(output / f"{name}.log", process)
        finally:
            _end(process, output / f"{name}.log")
            if process.stdin is not None:
                process.stdin.close()


def _end(process: subprocess.Popen[bytes], log: Path) -> None:
    """End a process of ours in order; where it stands still or this process is interrupted, kill it."""
    if process.poll() is not None:
        return
    process.send_signal(signal.SIGTERM)
    try:
        if sys.exception() is None:
            _wait(process, log, f"{log.stem} to end", lambda: process.poll() is not None)
        else:  # the demo has failed or is being stopped: what the process still writes nobody needs
            process.wait(_ENDING_S)
    except (AerodftError, subprocess.TimeoutExpired):
        _log.warning("%s: the demo's %s did not end by itself, and was killed", log, log.stem)
    finally:
        process.kill()
        process.wait()


def _failure(log: Path, process: subprocess.Popen[bytes]) -> AerodftError:
    last = (_lines(log) or ["it wrote nothing"])[-1]
    hint = "read the whole log"
    return AerodftError(
        f"the demo's {log.stem} process ended with exit code {process.returncode}: {last}", where=log, hint=hint
    )


def _command(*arguments: object) -> None:
    """One of our own commands, its words on stderr."""
    line = [sys.executable, "-m", "aerodft", *map(str, arguments)]
    done = subprocess.run(line, check=False, capture_output=True, text=True)  # noqa: S603 - our own interpreter
    if done.returncode:
        raise AerodftError(f"aerodft {arguments[0]} failed", got=done.stderr.strip() or str(done.returncode))


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else []


def listen(endpoint: str, station: str, path: Path) -> int:
    """Write every measurement that comes until SIGTERM; returns how many there were."""
    import zenoh

    from aerodft.adapters.bus import session_on
    from aerodft.cli.interrupts import wait_in_main_thread

    done = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: done.set())
    received = 0
    with path.open("wb") as out, session_on(None, [endpoint]) as session:

        def write(sample: zenoh.Sample) -> None:
            nonlocal received
            received += 1
            out.write(sample.payload.to_bytes() + b"\n")

        subscriber = session.declare_subscriber(f"aerodft/{station}/measurement/*", write)
        wait_in_main_thread(done)
        subscriber.undeclare()
    return received


def _end_with_parent() -> None:
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)  # which all of the demo's processes take as the end


def main() -> None:
    """Listen, or run the module that the arguments name as if it had been started itself."""
    if sys.argv[1] == "listen":
        listen(sys.argv[2], sys.argv[3], Path(sys.argv[4]))
        return
    module = sys.argv[2]
    sys.argv = sys.argv[2:]
    threading.Thread(target=_end_with_parent, name="end-with-parent", daemon=True).start()
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
