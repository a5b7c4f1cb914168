"""The live view in Foxglove where something is wrong with its viewers, or with the machine."""

import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from aerodft.adapters.outputs import Run
from aerodft.adapters.outputs.foxglove import FoxgloveTable, open_output
from aerodft.adapters.wire.pose import decode_pose
from aerodft.adapters.wire.status import StationStatus
from aerodft.errors import InputError
from aerodft.model import Image, Probe
from aerodft.sim import default_camera
from replay.recordings import Recording
from tests.adapters.outputs.foxglove_client import Viewer, deaf_viewer
from tests.batches import one_tick, step_outputs
from tests.payloads import decode_measurement
from tests.ports import free_tcp_port

FROZEN = Path("tests/cli/frozen-0.1")
NOISE = np.random.default_rng(1).integers(0, 255, (720, 1280, 3), dtype=np.uint8)


def a_run(*, is_live=True, probes=()):
    return Run(
        station="s",
        camera=default_camera(1280, 720),
        probes=probes,
        points={},
        is_live=is_live,
        measure=lambda _: [],
        put_observation=None,
        in_utc=lambda image: image,
    )


def show(server, index):
    image = Image(
        index=index,
        stamp_ns=index * 10**9,
        arrival_ns=index * 10**9,
        width_px=1280,
        height_px=720,
        pixels=lambda: NOISE,
    )
    server.take(one_tick(index * 10**9, [image]), step_outputs([()]))


def wait_until_subscribed(viewer, server):
    def is_heard():
        server.status(StationStatus(station="s", stamp_ns=1, state="running"))
        return viewer.of("aerodft/s/status")

    viewer.wait_for(is_heard)


def test_a_viewer_that_does_not_read_takes_nothing_from_others():
    port = free_tcp_port()
    with (
        closing(open_output(FoxgloveTable(port=port), a_run())) as server,
        deaf_viewer(port),
        Viewer(port) as viewer,
    ):
        wait_until_subscribed(viewer, server)
        for index in range(60):  # some 60 MB for the deaf one
            show(server, index)
            viewer.wait_for(lambda index=index: len(viewer.of("aerodft/s/image")) > index)
    assert len(viewer.of("aerodft/s/image/jpeg")) > 10
    assert server.warnings() == ()


def test_a_viewer_sees_what_is_drawn_of_the_very_first_image():
    recording, port = Recording(FROZEN), free_tcp_port()
    measured = next(each for each in map(decode_measurement, recording.measurements()) if each.value is not None)
    poses = (decode_pose(each.data) for each in recording.messages() if each.channel.topic.endswith("/pose"))
    probe = Probe(name=measured.name, kind=measured.kind, pixels=measured.pixels)
    outputs = step_outputs([(next(each for each in poses if each.pose is not None), measured)])
    with closing(open_output(FoxgloveTable(port=port), a_run(probes=(probe,)))) as server, Viewer(port) as viewer:
        wait_until_subscribed(viewer, server)
        server.take(one_tick(1, ()), outputs)
        viewer.wait_for(lambda: viewer.of(f"aerodft/s/number/{measured.name}"))
        viewer.wait_for(lambda: viewer.of("aerodft/s/annotations"))
    assert len(viewer.of("aerodft/s/transform")) == 1


def test_a_machine_that_is_too_slow_measures_on_and_says_what_was_not_shown(monkeypatch):
    with closing(open_output(FoxgloveTable(port=free_tcp_port()), a_run())) as server:
        monkeypatch.setattr(server._queue, "put", lambda _: False)  # noqa: SLF001 - full
        show(server, 1)
        show(server, 2)
    assert server.warnings() == ("2 ticks were not shown in Foxglove: the machine was too slow",)


def test_without_the_sdk_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(InputError, match=r"aerodft\[foxglove\]"):
        open_output(FoxgloveTable(), a_run())


def test_only_a_live_run_has_it():
    assert open_output(FoxgloveTable(), a_run(is_live=False)) is None
