"""Dialects of photographs, a module for each maker; ``DIALECTS`` is the registry.

A new dialect is a module with a ``DIALECT``, and one line here.
"""

from typing import Final

from aerodft.adapters.photographs.dialect import Dialect
from aerodft.adapters.photographs.makers import autel, dji, parrot, pix4d, siyi, skydio, teal

DIALECTS: Final[list[Dialect]] = [
    autel.DIALECT,
    skydio.DIALECT,
    parrot.DIALECT,
    pix4d.SENSEFLY,
    teal.DIALECT,
    siyi.DIALECT,
    dji.DIALECT,
    pix4d.DIALECT,
]
"""Asked in this order whether a photograph is theirs: those of a maker before those that several write."""
