"""What is said of input that is not whole."""

from collections.abc import Mapping


def incomplete_input(left_out: Mapping[str, int]) -> str:
    """What could not be read of a recording, as a sentence; empty where that is nothing.

    Args:
        left_out: How many of what, such as ``damaged_chunks``.
    """
    found = [
        f"{count} {what.replace('_', ' ').removesuffix('s' if count == 1 else '')}"
        for what, count in left_out.items()
        if count
    ]
    return f"the recording is not whole, and so is what came of it: without {' and '.join(found)}" if found else ""
