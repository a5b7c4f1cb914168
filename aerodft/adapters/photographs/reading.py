"""The pose of a photograph by the first dialect that recognises it."""

from dataclasses import replace

from aerodft.adapters.photographs.dialect import PhotoPose
from aerodft.adapters.photographs.makers import DIALECTS
from aerodft.adapters.photographs.tags import PhotoTags


def pose_of_tags(tags: PhotoTags) -> PhotoPose | None:
    """What a photograph says of its pose; None for one of no drone that is known here.

    Impossible values are left out, and said in ``PhotoPose.remarks``.
    """
    dialect = next((each for each in DIALECTS if each.recognises(tags)), None)
    if dialect is None:
        return None
    pose = dialect.read(tags)
    remarks = list(pose.remarks)
    if pose.wxyz is None and not any("angle" in each or "Pitch" in each for each in remarks):
        remarks.append("it states no angles of its camera")
    if pose.lat_rad is None and not any("position" in each for each in remarks):
        remarks.append("it states no position")
    return replace(pose, remarks=tuple(remarks))
