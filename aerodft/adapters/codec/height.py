"""``aerodft.height_switch/1``: heights are of another source from a stamp on, and by how much the two differ."""

from aerodft.adapters.codec import wire
from aerodft.model.height import HeightDifference, HeightSwitch
from aerodft.model.pose import HeightSource

SCHEMA = "aerodft.height_switch/1"


def encode_height_switch(switch: HeightSwitch) -> bytes:
    """A switch as ``aerodft.height_switch/1``."""
    step = switch.step
    return wire.dump(
        {
            "schema": SCHEMA,
            "stamp_ns": str(switch.stamp_ns),
            "before": switch.before,
            "after": switch.after,
            "step_m": None if step is None else step.step_m,
            "std_m": None if step is None else step.std_m,
            "before_m": None if step is None else step.height_m,
            "after_m": None if step is None else step.other_m,
            "compared_ns": None if step is None else str(step.stamp_ns),
            "software": wire.SOFTWARE,
        }
    )


def decode_height_switch(data: bytes) -> HeightSwitch:
    """``aerodft.height_switch/1`` to a switch.

    Raises:
        InputError: The payload is not of that schema.
    """
    return wire.load(data, SCHEMA, _switch)


def _switch(payload: wire.Json) -> HeightSwitch:
    before, after = HeightSource(payload["before"]), HeightSource(payload["after"])
    step = None
    if payload["compared_ns"] is not None:
        step = HeightDifference(
            stamp_ns=int(payload["compared_ns"]),
            source=before,
            other=after,
            height_m=wire.number(payload["before_m"]),
            other_m=wire.number(payload["after_m"]),
            std_m=wire.number(payload["std_m"]),
        )
    return HeightSwitch(stamp_ns=int(payload["stamp_ns"]), before=before, after=after, step=step)
