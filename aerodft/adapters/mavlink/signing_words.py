"""What became of a signed link's frames, as sentences and as JSON values."""

from typing import Any, Final

from aerodft.adapters.mavlink.signing import FUTURE, OLD, REPLAYED, UNSIGNED, WRONG, SigningCounts

_MEANING: Final = {
    UNSIGNED: "they carry no signature: somebody without the key sends, or the vehicle has signing off",
    WRONG: "their signature does not fit: somebody with another key sends, or this key file is not the vehicle's",
    REPLAYED: "their time stamp is not later than one seen before: somebody repeats them, or the network doubles them",
    OLD: "their time stamp is more than a minute behind: somebody plays a recording, or the vehicle's clock is slow",
    FUTURE: "their time stamp is more than a minute ahead: this machine's clock is slow, or the vehicle's is fast",
}


def signing_sentences(counts: SigningCounts) -> list[str]:
    """One sentence for each reason why frames were refused, with what it may mean."""
    sentences = [f"{count} frames refused, {_MEANING[reason]}" for reason, count in sorted(counts.refused.items())]
    if counts.refused and not counts.verified:
        sentences.append("not one frame with a good signature came: check the key on both sides, and both clocks")
    return sentences


def unchecked(signed: int, frames: int) -> str:
    """That a link without a key is signed: how many of its frames are."""
    return (
        f"this link is signed ({signed} of {frames} frames): without --signing-key, or telemetry.signing of a --config,"
        " nothing is checked, and the vehicle would ignore requests"
    )


def signing_document(counts: SigningCounts) -> dict[str, Any]:
    """The counters as plain JSON values."""
    return {"verified": counts.verified, "unsigned": counts.unsigned, "refused": dict(sorted(counts.refused.items()))}
