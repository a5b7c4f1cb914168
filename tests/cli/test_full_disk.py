"""A disk that fills up while something is recorded: what is lost is said, and the exit code says it too."""

import json
import subprocess
import sys

FEW_BYTES = 40_000


def test_a_recording_that_does_not_fit_is_a_loss(desk):
    limited = (
        f"import resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
        f" resource.setrlimit(resource.RLIMIT_FSIZE, ({FEW_BYTES}, {FEW_BYTES}));"
        f" from aerodft.cli.main import main; main()"
    )
    out = desk.folder / "rec"
    line = [sys.executable, "-c", limited, "import", desk.tlog(seconds=30.0), "-c", desk.config, "-o", out, "--json"]
    done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 5, done.stderr
    lost = json.loads(done.stdout)["lost"]
    assert lost > 100
    assert f"aerodft: {out}: {lost} messages are not in the recording: they could not be written" in done.stderr
    assert "Traceback" not in done.stderr
