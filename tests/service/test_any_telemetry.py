"""Whatever a vehicle's messages hold: no pose, no measurement and no health has anything in it that is not a number."""

import dataclasses
import math

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aerodft.adapters.telemetry.mavlink.decoding import WANTED
from aerodft.model import Probe, ProbeKind, Status
from aerodft.service import ZoomSettings
from tests.answers import measurements_of

MS = 1_000_000
SPECIAL = (0.0, 1.0, -1.0, 50.0, -1e4, 1e-40, 1e30, math.nan, math.inf, -math.inf)
PROBES = (
    Probe(name="centre", kind=ProbeKind.RANGE, pixels=((959.5, 539.5),)),
    Probe(name="width", kind=ProbeKind.DISTANCE, pixels=((600.0, 500.0), (1300.0, 520.0)), std_px=0.5),
)


def _field(wire_type, count, chosen):
    """A field's value, of as many bytes as it needs out of ``chosen``."""
    if wire_type == "char":
        return b""
    if wire_type in {"float", "double"}:
        numbers = SPECIAL
    else:
        bits = 8 * {"uint8_t": 1, "int8_t": 1, "uint16_t": 2, "int16_t": 2}.get(
            wire_type, 8 if "64" in wire_type else 4
        )
        numbers = (0, 1, 3, 25, (1 << bits - 1) - 1, -(1 << bits - 1) if wire_type.startswith("i") else (1 << bits) - 1)
    values = [numbers[next(chosen) % len(numbers)] for _ in range(count or 1)]
    return values if count else values[0]


@st.composite
def special_messages(draw):
    """A message that poses are made of, at a time of the flight, with numbers that nobody expects in the rest."""
    message_id, boot_ms, chosen = (
        draw(st.sampled_from(WANTED)),
        draw(st.integers(0, 2_900)),
        draw(st.binary(min_size=40)),
    )
    kind, more = dialect.mavlink_map[message_id], iter([*chosen, *bytes(200)])
    counts = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    fields = {name: _field(of, counts[name], more) for name, of in zip(kind.fieldnames, kind.fieldtypes, strict=True)}
    fields |= {"time_boot_ms": boot_ms} if "time_boot_ms" in fields else {}
    return boot_ms, bytes(kind(**fields).pack(dialect.MAVLink(None, srcSystem=1, srcComponent=1)))


def _numbers(item):
    """Every float in a value, however deep, with where it stands."""
    if isinstance(item, float):
        yield "", item
    elif isinstance(item, np.ndarray):
        yield from (("[]", float(each)) for each in item.ravel())
    elif dataclasses.is_dataclass(item):
        for each in dataclasses.fields(item):
            yield from ((f".{each.name}{path}", number) for path, number in _numbers(getattr(item, each.name)))
    elif isinstance(item, dict | tuple | list):
        for each in item.values() if isinstance(item, dict) else item:
            yield from ((f"[]{path}", number) for path, number in _numbers(each))


@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(special_messages(), min_size=1, max_size=40), st.booleans())
def test_nothing_that_is_no_number_reaches_what_is_published(bench, messages, curve) -> None:
    zoom = ZoomSettings(curve=((0.0, 1.0), (1.0, 6.0)) if curve else ())
    telemetry = dataclasses.replace(bench.settings.telemetry, zoom=zoom)
    pipeline = bench.pipeline(telemetry=telemetry, probes=PROBES)
    extra = [(bench.host0_ns + (ms + 30) * MS + k, frame) for k, (ms, frame) in enumerate(messages)]
    images = [bench.image(k, 500 + 600 * k) for k in range(4)]
    outputs = bench.run_events(*bench.blocks(sorted([*bench.flight(3.0), *extra])), *images, made=pipeline)
    for output in (*bench.poses(outputs), *measurements_of(outputs)):
        wrong = [(path, number) for path, number in _numbers(output) if not math.isfinite(number)]
        assert not wrong, output
        assert output.status is not Status.OK or getattr(output, "value", 0.0) is not None
    assert len(bench.poses(outputs)) == len(images)
    assert len(bench.measured(outputs, "width")) == len(images)
    health = pipeline.health(bench.host0_ns + 3_000 * MS)
    assert all(math.isfinite(number) for _, number in _numbers(health))
