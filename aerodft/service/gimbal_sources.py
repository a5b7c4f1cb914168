"""The registry of sources of the camera's attitude: ``GIMBAL_SOURCES``.

A new source is an entry of ``GIMBAL_SOURCES`` and a telemetry decoder that gives a ``GimbalTrack`` with its name. Its
name in station files, its angles' factors there, its place in the default order and in schemas follow.
"""

from dataclasses import dataclass
from typing import Final

from aerodft.model import GimbalSource


@dataclass(frozen=True, slots=True, kw_only=True)
class GimbalReports:
    """What is known of one source's reports; what an entry leaves out is estimated from the data, or taken for unsafe.

    Attributes:
        name: Name in station files, messages and ``GimbalTrack.source``.
        is_reported: Whether it comes in tracks; else it is stated.
        is_own_statement: Whether the camera itself states its attitude against north and the horizon, as measured at
            its stamp: no demand that the camera may lag behind, and never relative to the vehicle.
        has_failure_flags: Whether reports during a failure of the gimbal are marked and left out by the decoder; other
            sources' reports are not believed while one is known.
        is_stamped: Whether reports have a time stamp of their own; else their arrival is taken.
    """

    name: GimbalSource
    is_reported: bool = True
    is_own_statement: bool = False
    has_failure_flags: bool = False
    is_stamped: bool = True


GIMBAL_SOURCES: Final[dict[GimbalSource, GimbalReports]] = {
    each.name: each
    for each in (
        GimbalReports(name=GimbalSource.GIMBAL_DEVICE, has_failure_flags=True),
        GimbalReports(name=GimbalSource.MOUNT_ORIENTATION),
        GimbalReports(name=GimbalSource.MOUNT_STATUS, is_stamped=False),
        GimbalReports(name=GimbalSource.DATAFLASH_MNT),
        GimbalReports(name=GimbalSource.FIXED_MOUNT, is_reported=False),
        GimbalReports(name=GimbalSource.PHOTOGRAPH, is_own_statement=True),
        GimbalReports(name=GimbalSource.SUBTITLES, is_own_statement=True),
        GimbalReports(name=GimbalSource.TABLE, is_own_statement=True),
        GimbalReports(name=GimbalSource.KLV, is_own_statement=True),
        GimbalReports(name=GimbalSource.MANUAL, is_reported=False),
    )
}
"""All sources by name, those of reports in the default order of preference."""


def is_own_statement(source: GimbalSource) -> bool:
    """Whether a source is the camera's own statement, see ``GimbalReports``."""
    return source in GIMBAL_SOURCES and GIMBAL_SOURCES[source].is_own_statement


def reported_sources(*, own_statements: bool | None = None) -> tuple[GimbalSource, ...]:
    """Sources of reports in their order: all, or only those that are, or are not, cameras' own statements."""
    reported = (each for each in GIMBAL_SOURCES.values() if each.is_reported)
    return tuple(each.name for each in reported if own_statements in {None, each.is_own_statement})
