"""``aerodft.height_switch/1``: heights are of another source from a stamp on, and by how much the two differ."""

from aerodft.adapters.wire import payload as wire
from aerodft.model import HeightSwitch
from aerodft.version import SOFTWARE

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
            "software": SOFTWARE,
        }
    )
