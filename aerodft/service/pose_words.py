"""Why there is no pose, or what is to be said of one, in sentences."""

from typing import Final

from aerodft.conventions import SECOND_NS
from aerodft.model.pose import HeightSource, PoseSample
from aerodft.model.status import Status
from aerodft.service.settings import HeightSettings
from aerodft.service.streams import Missing

REBOOTED: Final = "the vehicle rebooted: what it had said before is forgotten"
HOME_MOVED: Final = "the vehicle rebooted: home may be elsewhere since, and heights above it count from there"


BY_GUESS: Final = "the vehicle has not said what UTC is: the receiving machine's clock is taken for it"
BY_HOST: Final = "the vehicle has not said what UTC is: the stamp is the receiving machine's clock"


def unplaced(missing: Missing, settings: HeightSettings) -> PoseSample:
    """Status and reason of a pose over ground of which nobody knows which part is below."""
    status, what = Status.NO_HEIGHT, "no position received yet"
    if missing is Missing.STALE:
        status, what = Status.STALE_TELEMETRY, no_place(settings)
    return PoseSample(stamp_ns=0, status=status, reasons=(f"{what}, and the ground is uneven",))


def no_place(settings: HeightSettings) -> str:
    """Why no place is stated, where positions come: none around the stamp, or two between which nothing flies."""
    return f"no believable position on both sides of the stamp within {settings.max_gap_ns / SECOND_NS:g} s"


def no_height(missing: Missing, settings: HeightSettings) -> str:
    """Why there is no height."""
    if missing is Missing.NEVER:
        return sentence("height", missing, settings.order, settings.max_gap_ns)
    near = {HeightSource.TERRAIN: f" and {settings.terrain_max_distance_m:g} m"}
    within = (f"{settings.gap_ns(each) / SECOND_NS:g} s{near.get(each, '')} from {each}" for each in settings.order)
    return f"no height on both sides of the stamp within {', '.join(within)}"


def sentence(what: str, missing: Missing, order: tuple[str, ...], max_gap_ns: int) -> str:
    """Why there is none of something that comes from one of several sources."""
    sources = ", ".join(order)
    if missing is Missing.NEVER:
        return f"no {what} received yet from {sources}"
    return f"no {what} on both sides of the stamp within {max_gap_ns / SECOND_NS:g} s from {sources}"
