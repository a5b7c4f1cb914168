"""What is said of input that is not whole."""

from aerodft.adapters.recording.read import Gap
from aerodft.adapters.timestamps import unix_ns_to_iso
from replay.recordings import LeftOut

_MOST_SAID = 3


def incomplete_input(left_out: LeftOut) -> str:
    """What could not be read of a recording, as a sentence; empty where that is nothing."""
    counts = {"damaged chunk": left_out.damaged_chunks, "missing segment": left_out.missing_segments}
    found = [f"{count} {what}{'s' * (count > 1)}" for what, count in counts.items() if count]
    times = [gap for gap in left_out.gaps if gap.from_ns is not None or gap.to_ns is not None]
    if times:
        said = ", ".join(map(_span, times[:_MOST_SAID]))
        more = f" and {len(times) - _MOST_SAID} more spans" if len(times) > _MOST_SAID else ""
        found.append(f"what was between {said}{more}")
    elif left_out.gaps and not found:
        found.append("what nobody knows the time of")
    return f"the recording is not whole, and so is what came of it: without {' and '.join(found)}" if found else ""


def left_out_document(left_out: LeftOut) -> dict[str, object]:
    """The counts and times of ``incomplete_input`` for a JSON document."""
    return {
        "damaged_chunks": left_out.damaged_chunks,
        "missing_segments": left_out.missing_segments,
        "gaps": [
            {
                "from_ns": None if gap.from_ns is None else str(gap.from_ns),
                "to_ns": None if gap.to_ns is None else str(gap.to_ns),
                "messages": gap.messages,
            }
            for gap in left_out.gaps
        ],
    }


def _span(gap: Gap) -> str:
    begin = "the beginning" if gap.from_ns is None else unix_ns_to_iso(gap.from_ns)
    end = "the end" if gap.to_ns is None else unix_ns_to_iso(gap.to_ns)
    return f"{begin} and {end}"
