"""A replay answers queries as the station did at the time that is being replayed: over a real socket, at any time."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import orjson
import pytest
import zenoh

from aerodft.adapters.bus import session_on
from aerodft.app.replay import Replay
from replay.foreign import open_recording
from replay.player import Controls
from replay.recordings import Recording
from tests.cli.conftest import UTC0_NS
from tests.ports import free_endpoint
from tests.replay.foreign_files import frames_of, write_foreign

CENTRE = {"name": "centre", "kind": "range", "pixels": [[31.5, 23.5]]}
PATIENCE_S = 30.0


def wait_until(is_so: Callable[[], bool]) -> None:
    until_s = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < until_s
        time.sleep(0.01)


def ask(session: zenoh.Session, key: str, question: object = None) -> object:
    payload = None if question is None else orjson.dumps(question)
    (reply,) = session.get(key, payload=payload, timeout=PATIENCE_S)
    return orjson.loads((reply.ok or reply.err).payload.to_bytes())


@contextmanager
def stepped(path, images: int, *, loop: bool = False, **more: object) -> Iterator[tuple[zenoh.Session, Replay]]:
    """A replay that has paused behind so many images."""
    endpoint, controls = free_endpoint(), Controls(paused=True, looping=loop)
    pauses = []
    with Replay([open_recording(path)], rate=None, listen=endpoint, controls=controls, **more) as replay:
        thread = threading.Thread(target=replay.play, kwargs={"on_pause": lambda *_: pauses.append(1)})
        thread.start()
        try:
            for number in range(images + 1):
                wait_until(lambda number=number: len(pauses) > number)
                if number < images:
                    controls.step()
            with session_on(None, [endpoint]) as session:
                yield session, replay
        finally:
            controls.end()
            thread.join(PATIENCE_S)


def centres(path) -> list[dict]:
    found = map(orjson.loads, Recording(path).measurements())
    return [each for each in found if each["name"] == "centre"]


def test_measure_and_history_are_those_of_the_time_that_is_replayed(flight_recording):
    recorded = centres(flight_recording)
    for images in (3, 7):
        with stepped(flight_recording, images) as (session, _):
            published = ask(session, "aerodft/test/history", {"name": "centre"})
            assert published == recorded[: len(published)]
            assert 0 < len(published) < len(recorded)
            (newest,) = ask(session, "aerodft/test/measure", CENTRE)
            assert {**newest, "image": published[-1]["image"]} == published[-1]
            (before,) = ask(session, "aerodft/test/measure", {**CENTRE, "stamp_ns": published[0]["stamp_ns"]})
            assert before["value"] == pytest.approx(published[0]["value"], abs=1e-6)
            assert before["stamp_ns"] == published[0]["stamp_ns"]
            late_ns = str(UTC0_NS + 900 * 10**9)
            (late,) = ask(session, "aerodft/test/measure", {**CENTRE, "stamp_ns": late_ns})
            assert (late["value"], late["status"] != "ok") == (None, True)


def test_probes_are_those_of_the_recorded_station_also_before_anything_is_played(flight_recording):
    with stepped(flight_recording, 0) as (session, _):
        probes = ask(session, "aerodft/test/probes")
        assert [(each["name"], each["source"]) for each in probes] == [("centre", "fixed"), ("width", "observed")]
        assert ask(session, "aerodft/test/history") == []
        (answer,) = ask(session, "aerodft/test/measure", CENTRE)
        assert (answer["value"], answer["reasons"]) == (None, ["no image has been measured yet"])
        wrong = ask(session, "aerodft/test/measure", {"kind": "volume"})
        assert (wrong["code"], "kind: got" in wrong["sentence"]) == (3, True)


def test_stamps_that_are_moved_are_moved_in_questions_and_answers(flight_recording):
    recorded = centres(flight_recording)
    with stepped(flight_recording, 5, is_now=True) as (session, _):
        published = ask(session, "aerodft/test/history", {"name": "centre"})
        shift_ns = int(published[0]["stamp_ns"]) - int(recorded[0]["stamp_ns"])
        assert shift_ns > 0
        (answer,) = ask(session, "aerodft/test/measure", {**CENTRE, "stamp_ns": published[1]["stamp_ns"]})
        assert answer["stamp_ns"] == published[1]["stamp_ns"]
        assert answer["value"] == pytest.approx(recorded[1]["value"], abs=1e-6)


def test_a_second_round_begins_anew(flight_recording):
    with stepped(flight_recording, 13, loop=True) as (session, replay):
        assert replay.result.rounds == 1, "of ten images"
        published = ask(session, "aerodft/test/history", {"name": "centre"})
        assert 0 < len(published) < 5
        (answer,) = ask(session, "aerodft/test/measure", CENTRE)
        assert answer["stamp_ns"] == published[-1]["stamp_ns"]


def test_another_tools_recording_says_that_it_has_no_station(desk, tmp_path):
    path = write_foreign(tmp_path / "a.mcap", frames_of(desk.log))
    with stepped(path, 2) as (session, _):
        for key in ("probes", "measure"):
            refused = ask(session, f"aerodft/a/{key}", CENTRE)
            assert refused["code"] == 4
            assert refused["sentence"] == (
                f"{path}: another tool's recording has no station to ask;"
                " `import_flight` makes a recording of a station from it"
            )


def test_a_recording_without_its_configuration_says_so(flight_recording, tmp_path):
    for each in flight_recording.glob("*.mcap"):
        content = each.read_bytes()
        (tmp_path / each.name).write_bytes(content.replace(b"config.toml", b"config.xxxx"))
    with stepped(tmp_path, 2) as (session, _):
        refused = ask(session, "aerodft/test/measure", CENTRE)
        assert (refused["code"], "no config.toml" in refused["sentence"]) == (3, True)
