"""The bus as another process sees it, over a real loopback socket."""

import json
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from queue import Queue

import numpy as np
import orjson
import pytest
import zenoh
from jsonschema import Draft202012Validator

from aerodft.adapters.bus import ZenohBus, open_session, session_on
from aerodft.adapters.wire.requests import MeasureRequest, parse_measure_request
from aerodft.adapters.wire.schemas import SCHEMAS
from aerodft.adapters.wire.status import StationStatus
from aerodft.errors import InputError, LinkError, NoAnswerError
from aerodft.geometry import camera_attitude
from aerodft.model import (
    CalibrationEstimate,
    Image,
    Measurement,
    Pose,
    PoseSample,
    Probe,
    ProbeKind,
    ProjectionModel,
    Status,
)
from tests.batches import one_tick, step_outputs, take
from tests.payloads import decode_measurement
from tests.ports import free_endpoint

LONGEST_PUBLISH_S = 1.0  # a machine that is busy otherwise; waiting for the listener would take for ever
PATIENCE_S = 60.0
TICK = one_tick(50, [])

PROBES = (Probe(name="w", kind=ProbeKind.DISTANCE, pixels=((1, 2), (3, 4))),)

LISTENER = """
    import json, sys, zenoh
    config = zenoh.Config()
    for key, value in (("mode", "client"), ("connect/endpoints", [sys.argv[1]]), ("scouting/multicast/enabled", False)):
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session, session.declare_subscriber(sys.argv[2]) as subscriber:
        session.declare_queryable("listener/ready", lambda query: query.reply("listener/ready", b"yes"))
        print("ready", flush=True)
        for sample in subscriber:
            attachment = sample.attachment
            print(json.dumps([str(sample.key_expr), str(sample.encoding), sample.payload.to_bytes().hex(),
                              None if attachment is None else attachment.to_string()]), flush=True)
            if str(sample.key_expr).endswith("/status"):
                break
"""


@contextmanager
def listener(endpoint: str, key: str = "aerodft/**") -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(LISTENER), endpoint, key], stdout=subprocess.PIPE
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == b"ready\n"
            yield process
        finally:
            process.kill()


def wait_for_listener(endpoint: str) -> None:
    """A query goes the same way as the declaration of the subscriber before it."""
    with session_on(None, [endpoint]) as session:
        patience_ends = time.monotonic() + PATIENCE_S
        while time.monotonic() < patience_ends:
            if any(reply.ok for reply in session.get("listener/ready", timeout=1.0)):
                return
            time.sleep(0.01)
    raise AssertionError("the listener never came")


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


@contextmanager
def a_bus(endpoint: str, **more: object) -> Iterator[ZenohBus]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("aerodft.adapters.bus.IMAGE_HZ", 100.0)
        patch.setattr("aerodft.adapters.bus.MOST_HISTORY", 3)
        with closing(ZenohBus("s", endpoint, probes=PROBES, **more)) as bus:
            yield bus


def a_sample(stamp_ns: int = 5) -> PoseSample:
    return PoseSample(
        stamp_ns=stamp_ns,
        status=Status.OK,
        pose=Pose(position_enu_m=np.array([0.0, 0, 30]), wxyz=camera_attitude(0.5, 0.0, 1.0)),
    )


def a_measurement(index: int, name: str = "w") -> Measurement:
    return Measurement(
        name=name,
        kind=ProbeKind.DISTANCE,
        status=Status.OK,
        reasons=(),
        stamp_ns=index,
        pixels=((1.0, 2.0), (3.0, 4.0)),
        std_px=1.0,
        camera="c",
        model=ProjectionModel.PINHOLE,
        pose=a_sample(),
        value=float(index),
    )


def ask(session: zenoh.Session, key: str, question: object = None) -> object:
    payload = None if question is None else orjson.dumps(question)
    (reply,) = session.get(key, payload=payload, timeout=10.0)
    assert reply.ok is not None
    assert reply.ok.encoding == zenoh.Encoding.APPLICATION_JSON
    return orjson.loads(reply.ok.payload.to_bytes())


def refusal(session: zenoh.Session, key: str, question: object = None) -> tuple[int, str]:
    payload = None if question is None else orjson.dumps(question)
    (reply,) = session.get(key, payload=payload, timeout=10.0)
    assert reply.err is not None
    assert reply.err.encoding == zenoh.Encoding.APPLICATION_JSON
    found = orjson.loads(reply.err.payload.to_bytes())
    Draft202012Validator(SCHEMAS["aerodft.error/1"]).validate(found)
    return found["code"], found["sentence"]


def test_another_process_receives_everything_valid(endpoint: str) -> None:
    shot = Image(
        index=7, stamp_ns=3, arrival_ns=4, width_px=8, height_px=6, pixels=lambda: np.zeros((6, 8, 3), np.uint8)
    )
    with a_bus(endpoint) as bus, listener(endpoint) as process:
        wait_for_listener(endpoint)
        take(bus, one_tick(50, [shot]))
        for index in range(100):
            take(bus, TICK, a_sample(), a_measurement(index), a_measurement(index, "w/b"))
            time.sleep(0.002)  # far faster than any camera; all at once a listener that gets no processor loses some
        take(bus, TICK, CalibrationEstimate(stamp_ns=9, calibration="live:x:1"))
        take(bus, TICK)
        bus._image_queue.close()  # noqa: SLF001 - the image is on its way before the last message
        bus.status(StationStatus(station="s", stamp_ns=1, state="running"))
        assert process.stdout is not None
        got = [json.loads(line) for line in process.stdout]
    by_key: dict[str, list[bytes]] = {}
    for key, encoding, payload, attachment in got:
        data = bytes.fromhex(payload)
        by_key.setdefault(key, []).append(data)
        if encoding == "image/jpeg":
            assert data[:2] == b"\xff\xd8"
            data = attachment.encode()
        else:
            assert encoding == "application/json"
        document = orjson.loads(data)
        Draft202012Validator(SCHEMAS[document["schema"]]).validate(document)
    assert [decode_measurement(data).stamp_ns for data in by_key["aerodft/s/measurement/w"]] == list(range(100))
    assert {key: len(items) for key, items in by_key.items()} == {
        "aerodft/s/measurement/w": 100,
        "aerodft/s/measurement/w%2Fb": 100,
        "aerodft/s/pose": 100,
        "aerodft/s/calibration": 1,
        "aerodft/s/image": 1,
        "aerodft/s/status": 1,
    }


def test_questions_are_answered(endpoint: str) -> None:
    asked: list[MeasureRequest] = []

    def on_measure(question: bytes) -> list[Measurement]:
        asked.append(parse_measure_request(question, {}))
        return [a_measurement(9)]

    with a_bus(endpoint, on_measure=on_measure) as bus, session_on(None, [endpoint]) as client:
        question = {"kind": "distance", "pixels": [[1, 2], [3, 4]], "stamp_ns": "12", "std_px": 0.5, "elevation_m": 2}
        answer = ask(client, "aerodft/s/measure", question)
        assert [item["value"] for item in answer] == [9.0]
        assert (asked[0].stamp_ns, asked[0].probe.std_px, asked[0].probe.elevation_m) == (12, 0.5, 2.0)
        (probe,) = ask(client, "aerodft/s/probes")
        assert (probe["name"], probe["kind"], probe["pixels"]) == ("w", "distance", [[1, 2], [3, 4]])
        take(bus, TICK, *(a_measurement(index, name) for index, name in enumerate("abab")))
        bus._queue.close()  # noqa: SLF001 - history is written by its thread
        assert [item["name"] for item in ask(client, "aerodft/s/history")] == ["b", "a", "b"]
        assert [item["stamp_ns"] for item in ask(client, "aerodft/s/history", {"last": 1, "name": "b"})] == ["3"]
        assert ask(client, "aerodft/s/history", {"last": 0}) == []
        for malformed, got in (({"last": "x"}, '"x"'), ([1, None], "[1,null]"), ({"kind": "width"}, "")):
            code, sentence = refusal(client, "aerodft/s/history", malformed)
            assert (code, "last" in sentence, f"got {got}" in sentence or not got) == (3, True, True), sentence


@pytest.mark.parametrize(
    ("question", "said"),
    [
        (None, "not JSON"),
        ([1], "no JSON object"),
        ({"kind": "volume"}, 'kind: got "volume", expected one of'),
        ({"kind": "distance", "pixels": [[1, 2]]}, "pixels: got 1 pixel, expected 2 x [u, v] for distance"),
        ({"kind": "distance", "pixels": "ab"}, 'pixels: got "ab", expected a list'),
        ({"kind": "range", "pixels": [[1, None]]}, "pixels[0][1]: got null, expected a number"),
        ({"kind": "range", "pixels": [[1, 2]], "colour": 1}, "unknown key"),
        ({"kind": "range", "pixels": [[1, 2]], "name": 3}, "name: got 3, expected text"),
        ({"kind": "range", "pixels": [[1, 2]], "stamp_ns": 1.5}, "stamp_ns: got 1.5, expected a whole number"),
        ({"kind": "range", "pixels": [[1, 2]], "std_px": 0}, "std_px"),
        ({"kind": "range", "pixels": [[1, 2]], "elevation_m": "2"}, "elevation_m"),
        ({"kind": "range", "pixels": [[1, 2]], "name": "refused"}, "no pose yet"),
        ({"kind": "range", "pixels": [[1, 2]], "name": "no answer"}, "too early"),
        ({"kind": "range", "pixels": [[1, 2]], "name": "bug"}, "internal error: KeyError"),
    ],
)
def test_every_question_gets_an_answer(
    endpoint: str, question: object, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    def on_measure(question: bytes) -> list[Measurement]:
        name = parse_measure_request(question, {}).probe.name
        if name == "refused":
            raise InputError("no pose yet")
        if name == "no answer":
            raise NoAnswerError("too early")
        raise KeyError(name)

    with a_bus(endpoint, on_measure=on_measure), session_on(None, [endpoint]) as client:
        code, sentence = refusal(client, "aerodft/s/measure", question)
    assert said in sentence
    assert "\n" not in sentence
    assert code == {"internal error: KeyError": 1, "too early": 4}.get(said, 3)
    assert ("could not be answered" in caplog.text) == ("internal" in said)


def test_observations_come_in_and_nonsense_is_counted(endpoint: str, caplog: pytest.LogCaptureFixture) -> None:
    seen = Queue()
    with a_bus(endpoint, on_observation=seen.put) as bus, session_on(None, [endpoint]) as client:
        for _ in range(200):  # until the subscription is known to the client
            client.put("aerodft/s/observation/w%2Fb", b"nonsense")
            client.put("aerodft/s/observation/w%2Fb", b'{"stamp_ns": "7", "pixels": [[1, 2.5]]}')
            if not seen.empty():
                break
        got = seen.get(timeout=10)
        assert (got.name, got.stamp_ns, got.pixels) == ("w/b", 7, ((1.0, 2.5),))
        assert got.source == "aerodft/s/observation/w%2Fb"
        assert bus.warnings()
    assert caplog.text.count("observation left out") == 1


def test_the_station_is_seen_to_live_and_to_go(endpoint: str) -> None:
    changes: Queue[zenoh.SampleKind] = Queue()
    with session_on(endpoint) as watcher:
        watched = watcher.liveliness().declare_subscriber("aerodft/*/alive", lambda sample: changes.put(sample.kind))
        bus = ZenohBus("s", None, (endpoint,))
        assert changes.get(timeout=10) == zenoh.SampleKind.PUT
        bus.close()
        assert changes.get(timeout=10) == zenoh.SampleKind.DELETE
        watched.undeclare()


def test_a_busy_port_and_a_wrong_address_are_named(endpoint: str) -> None:
    with a_bus(endpoint), pytest.raises(LinkError, match=f"{endpoint}: the port is busy"):
        open_session(endpoint)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("", "got ''"),
        ("nonsense", "got 'nonsense'"),
        ("tcp/", "without a host"),
        ("tcp/localhost", "without a port"),
        ("tcp/127.0.0.1:99999", "'99999' for a port"),
        ("tcp/127.0.0.1:x", "'x' for a port"),
        ("gopher/127.0.0.1:70", "'gopher' for a protocol"),
        ("tcp/no-host.invalid:7447", "a host that nobody knows"),
        ("tcp/192.0.2.1:7447", "Cannot assign requested address"),
        ("tls/127.0.0.1:0", "no certificate"),
    ],
)
def test_what_is_no_endpoint_is_said_in_words_of_ours(given: str, said: str) -> None:
    with pytest.raises(LinkError) as caught:
        open_session(given)
    sentence = str(caught.value)
    assert said in sentence
    assert sentence.endswith("expected an endpoint such as tcp/127.0.0.1:7447")
    assert not any(word in sentence for word in (".rs", "Json5", "zenoh", "(os error"))


def test_closing_leaves_no_thread_and_frees_the_port(endpoint: str) -> None:
    before = set(threading.enumerate())
    for _ in range(2):
        with a_bus(endpoint, on_observation=lambda _: None, on_measure=lambda _: []):
            pass
    for thread in set(threading.enumerate()) - before:
        thread.join(10)
        assert not thread.is_alive(), thread.name


def test_a_listener_that_hangs_holds_nobody_up(endpoint: str) -> None:
    with a_bus(endpoint) as bus, listener(endpoint, "aerodft/s/pose") as process:
        wait_for_listener(endpoint)
        process.send_signal(signal.SIGSTOP)
        batches, outputs = TICK, step_outputs([[a_sample()]])
        slowest_s = 0.0
        for _ in range(20_000):
            start_s = time.perf_counter()
            bus.take(batches, outputs)
            slowest_s = max(slowest_s, time.perf_counter() - start_s)
    assert slowest_s < LONGEST_PUBLISH_S
