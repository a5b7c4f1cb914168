"""The library of cameras: which of its modes a name, an image or a video is of, and its camera file."""

from pathlib import Path

import tomli_w

from aerodft.adapters.config.camera import KnownCamera, camera_document, known_cameras
from aerodft.adapters.files import whole_file
from aerodft.adapters.images import STILLS, facts_of_still, video_info
from aerodft.errors import NoAnswerError


def find_cameras(wanted: str | Path | None = None) -> tuple[KnownCamera, ...]:
    """The modes of the library's cameras that are wanted.

    Args:
        wanted: Words of a camera's name, its name in EXIF data, ``photo`` or ``video``, a size like ``3840x2160``, or
            parts of them; or a photo, whose EXIF data and size tell; or a video, whose size tells alone; None for all.

    Raises:
        NoAnswerError: There are none.
        InputError: The photo or video cannot be read.

    Example:
        >>> import aerodft as ad
        >>> [found.camera.fx_px for found in ad.find_cameras("FC6310R photo")]
        [3666.8]
    """
    cameras, path = known_cameras(), Path(str(wanted))
    if wanted is None:
        return cameras
    if path.is_file() and path.suffix.lower() in STILLS:
        facts = facts_of_still(path)
        size_px, mode = facts.size_px, facts.mode
        found = [each for each in cameras if each.shows(size_px, mode)]
        got = f'{size_px[0]} x {size_px[1]} px of "{mode.device or "no device"}"'
    elif path.is_file():
        info = video_info(path)
        size_px = (info.width_px, info.height_px)
        found = [
            each
            for each in cameras
            if each.kind == "video" and size_px == (each.camera.width_px, each.camera.height_px)
        ]
        got = f"{info.width_px} x {info.height_px} px"
    else:
        words = str(wanted).casefold().split()
        found = [each for each in cameras if set(words) <= set(_words(each).split())]
        found = found or [each for each in cameras if all(word in _words(each) for word in words)]
        got = str(wanted)
    if not found:
        hint = "calibrate the lens with `calibrate_lens`, or write a camera file with its field of view"
        raise NoAnswerError("no camera of the library", where=wanted if path.is_file() else "", got=got, hint=hint)
    return tuple(found)


def write_camera(known: KnownCamera, path: Path, *, overwrite: bool = False) -> None:
    """Write the camera file of a camera of the library, with where its figures are from.

    Args:
        known: The camera.
        path: The TOML file.
        overwrite: Whether one that exists is replaced.

    Raises:
        InputError: It exists, or cannot be written.

    Example:
        >>> import aerodft as ad
        >>> ad.write_camera(ad.find_cameras("FC7303 4000x3000")[0], Path("mini2.toml"))
        >>> ad.load_camera("mini2.toml").width_px
        4000
    """
    share = 100 * known.camera.std.focal_px / known.camera.fx_px
    about = (
        f"# {known.camera.name}. Focal length from: {known.source} ({known.known_from}), to {share:.1f} % (1 sigma).\n"
        "# No distortion is stated. `aerodft calibrate-lens` finds both for your own copy, ten times as well.\n"
    )
    with whole_file(path, overwrite=overwrite) as partial:
        partial.write_text(about + tomli_w.dumps(camera_document(known.camera)), encoding="utf-8")


def _words(known: KnownCamera) -> str:
    device = "" if known.camera.mode is None else known.camera.mode.device
    return f"{known.camera.name} {device}".casefold().replace(",", "")
