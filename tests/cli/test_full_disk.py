"""A disk that fills up while something is recorded: what is lost is said, and the exit code says it too."""

import json
import subprocess
import sys

LIMITED = """
import resource
from aerodft.adapters.recording.write.recorder import McapRecorder
from aerodft.cli.main import main
begin = McapRecorder.__init__
def begin_and_fill_up(*arguments, **options):
    begin(*arguments, **options)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
McapRecorder.__init__ = begin_and_fill_up
main()
"""


def test_a_recording_that_does_not_fit_is_a_loss(desk):
    out = desk.folder / "rec"
    line = [sys.executable, "-c", LIMITED, "import", desk.tlog(seconds=30.0), "-c", desk.config, "-o", out, "--json"]
    done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 5, done.stderr
    lost = json.loads(done.stdout)["lost"]
    assert lost > 100
    assert f"aerodft: {out}: {lost} messages are not in the recording: they could not be written" in done.stderr
    assert "Traceback" not in done.stderr
