"""Who else speaks on a link and might be meant as well as who is followed: named, where nobody chose."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from aerodft.adapters.mavlink import selection as pick
from aerodft.adapters.mavlink.dialect import message_name
from aerodft.adapters.mavlink.layout import TABLE_IDS
from aerodft.model.arrays import BoolArray, IntArray
from aerodft.model.health import RivalTrack
from aerodft.model.telemetry import NO_BOOT_TIME, RawBlock

_OF_VEHICLES: Final = (pick.ATTITUDE, pick.GLOBAL_POSITION_INT)
_OF_GIMBALS: Final = (pick.MOUNT_STATUS, pick.MOUNT_ORIENTATION, pick.GIMBAL_DEVICE_ATTITUDE_STATUS)


def _table() -> BoolArray:
    """``(65536,)`` by message id: whether a message that was left out may be of a rival."""
    table = np.zeros(TABLE_IDS, dtype=np.bool_)
    table[[*_OF_VEHICLES, *_OF_GIMBALS]] = True
    return table


_TELLS: Final = _table()


class Rivals:
    """Names whoever else could have been followed: other vehicles, autopilots and gimbals.

    Args:
        followed: What was chosen; of that there are no rivals.
    """

    def __init__(self, followed: pick.Followed) -> None:
        self._followed = followed

    def tracks(self, block: RawBlock, heads: IntArray, slots: IntArray, state: IntArray) -> Iterator[RivalTrack]:
        """One track for each of them that spoke in a block.

        Args:
            block: The frames.
            heads: ``(5, n)`` their headers.
            slots: ``(n,)`` which were selected: -1 for what was left out.
            state: Of the selection, which knows who is followed.
        """
        if state[pick.COMPONENT] < 0:
            return
        aside = np.flatnonzero(slots < 0)
        aside = aside[_TELLS[np.clip(heads[0, aside], 0, TABLE_IDS - 1)]]
        if not len(aside):
            return
        who, member = np.unique(heads[:3, aside], axis=1, return_inverse=True)
        for number, (message_id, system, component) in enumerate(who.T.tolist()):
            what = self._sentence(message_id, system, component, state)
            if what is not None:
                rows = aside[member.ravel() == number]
                none = np.full(len(rows), NO_BOOT_TIME, dtype=np.int64)
                yield RivalTrack(arrival_ns=block.arrival_ns[rows], boot_ns=none, what=what)

    def _sentence(self, message_id: int, system: int, component: int, state: IntArray) -> str | None:
        """Who sent a message that was left out; None where it is nobody who could have been meant."""
        own_system, own_component = int(state[pick.SYSTEM]), int(state[pick.COMPONENT])
        if system != own_system:
            is_rival = self._followed.system is None and not self._is_of_gimbal(message_id, component)
            other, own, key = f"system {system}", f"system {own_system}", "system"
            return _heard_too(f"{other} is on the link too", own, key) if is_rival else None
        if message_id in _OF_GIMBALS:
            return None if self._followed.gimbal is not None else _gimbal(message_id, component, state)
        is_rival = component != own_component and self._followed.component is None and not pick.is_peripheral(component)
        what = f"component {component} of system {system} is an autopilot too"
        return _heard_too(what, f"component {own_component}", "component") if is_rival else None

    def _is_of_gimbal(self, message_id: int, component: int) -> bool:
        return message_id in _OF_GIMBALS or pick.is_peripheral(component)


def _gimbal(message_id: int, component: int, state: IntArray) -> str | None:
    """Which gimbal a message is of, beside the one that is followed."""
    slot = pick.WANTED.index(message_id)
    sender = int(state[pick.LOCKS + slot])
    if sender < 0:
        return None
    name, own = message_name(message_id), sender & 0xFF
    if component == own:
        what = f"{name} of component {component} is of several gimbals"
        return _heard_too(what, f"number {pick.device_of(state, slot)}", "gimbal")
    return _heard_too(f"{name} comes from component {component} too", f"component {own}", "gimbal")


def _heard_too(what: str, own: str, key: str) -> str:
    return f"{what}: {own} was heard first and is followed; choose with telemetry.{key}"
