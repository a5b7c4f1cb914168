"""The registry of other tools' camera files, and what reads one of any of them as the keys of a camera file.

A new format is a module that has what ``CameraFormat`` says, and one line here.
"""

from typing import Any, Final, Protocol

from aerodft.adapters.config.camera.formats import agisoft, colmap, kalibr, opencv, opensfm, ros


class CameraFormat(Protocol):
    """A module that reads one tool's camera files."""

    def recognises(self, text: str) -> bool:
        """Whether a file with this text is of this format."""

    def read(self, text: str) -> dict[str, Any]:
        """Keys of a camera file; ``name`` where the file states one.

        Raises:
            ConfigError: A value is missing or impossible, or the lens has a model that aerodft does not have.
        """


CAMERA_FORMATS: Final[list[CameraFormat]] = [
    kalibr,
    ros,
    opencv,
    opensfm,
    agisoft,
    colmap,
]
"""Asked in this order whether a file is theirs."""


def read_other_camera(data: bytes, name: str) -> dict[str, Any] | None:
    """Keys of a camera file by another tool's camera file; None for a file of none of the formats.

    Args:
        data: The file's bytes.
        name: The camera's name where the file states none.

    Raises:
        ConfigError: A value is missing or impossible, or the lens has a model that aerodft does not have.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return None
    found = next((each for each in CAMERA_FORMATS if each.recognises(text)), None)
    return None if found is None else {"name": name} | found.read(text)
