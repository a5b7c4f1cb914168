"""The benchmarks run: in small here, in full with ``make bench``."""

import re
import runpy
from pathlib import Path

import pytest

pytestmark = pytest.mark.nightly

HERE = Path(__file__).parent


@pytest.mark.parametrize(
    ("script", "options", "says"),
    [
        ("bench_batch.py", ["--recordings", "2", "--seconds", "2"], r"two workers take \d\.\d\d of the time of one"),
        ("bench_calibration.py", ["--landmarks", "20", "--runs", "1"], r"20 landmarks, .* ms; \d+\.\d+, \d+\.\d+"),
        ("bench_import.py", ["--seconds", "4", "--probes", "2", "--rate", "5"], r"recompute +.* times real time"),
        (
            "bench_dense.py",
            ["--width", "320", "--pixels", "2000", "--runs", "1"],
            r"bent: .* one with a known pose",
        ),
        (
            "bench_live.py",
            ["--rate", "500", "--seconds", "0.5", "--flood", "1000"],
            r"500 messages/s: 0 of 250 lost[^$]*pymavlink: .* of it[^$]*garbage datagrams/s: 0 of",
        ),
        ("bench_query.py", ["--queries", "50"], r"p99 \d+\.\d\d ms"),
        ("bench_replay.py", ["--megabytes", "4"], r"MB of memory in all[^$]*of the time that the stock reader"),
        (
            "bench_river.py",
            ["--width", "960", "--runs", "1"],
            r"images/s of one core[^$]*where the time goes: network [1-9]",
        ),
        ("bench_recompute.py", ["--seconds", "5", "--rate", "2"], r"recompute: \d+ times real time.*MB on disk"),
        (
            "bench_sync.py",
            ["--seeds", "1", "--first", "1", "--seconds", "12", "--width", "320"],
            r"of 1 within 20 ms[^$]*95 % intervals: offset",
        ),
        ("bench_terrain.py", ["--cells", "64", "--step", "40"], r"tilt 70: .* million rays/s"),
        ("bench_tracked.py", ["--images", "2"], r"tracked probes, 1080p[^$]*images/s[^$]*moving objects, 1080p"),
        ("bench_tlog.py", ["--tiles", "1"], r"recv_match of all messages .* times as long"),
    ],
)
def test_it_runs_and_prints_its_figures(script, options, says, capsys):
    runpy.run_path(str(HERE / script))["main"](options)
    assert re.search(says, capsys.readouterr().out)


def test_without_the_peer_the_benchmark_says_so():
    main = runpy.run_path(str(HERE / "bench_cameratransform.py"))["main"]
    main.__globals__["succeeds"] = lambda *_: False
    with pytest.raises(SystemExit, match=r"cannot be installed in \.venv-peer: that needs the network"):
        main([])
