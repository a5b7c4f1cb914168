"""Values of other tools' files by their keys, and the keys of a camera file that follow from them."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from aerodft.conventions import LARGEST
from aerodft.errors import ConfigError, counted
from aerodft.model import LensModel

_MAX_SIZE_PX: Final = 10_000_000  # as of camera files
_MAX_CENTRE_OFFSET: Final = 0.2
"""Of the principal point from the image's centre, as a share of the image's size. Chosen: calibrations are within 0.05,
those of an image of half or twice the size are off by 0.25 and 0.5. At 0.4 half the size passes."""
_MAX_SHOWN: Final = 62  # letters of a value: one line of a terminal
_COPY: Final = "copy fx_px, fy_px, cx_px, cy_px and distortion into a TOML camera file"


class Values:
    """Values of one table of a file; what is missing or impossible is refused by the path of its key.

    Args:
        values: The table; numbers may be written as text.
        path: Key path of the table in its file, with a trailing dot; empty for the file's root.
    """

    def __init__(self, values: Mapping[str, Any], path: str = "") -> None:
        self._values, self._path = values, path

    def __contains__(self, key: str) -> bool:
        """Whether the table has this key."""
        return key in self._values

    def key_of(self, *names: str) -> str:
        """The first of several names that the table has; the first name where it has none."""
        return next((name for name in names if name in self._values), names[0])

    def path(self, key: str) -> str:
        """The key's path in its file."""
        return self._path + key

    def table(self, key: str) -> "Values":
        """The table below a key."""
        value = self._values.get(key)
        if not isinstance(value, Mapping):
            raise ConfigError(self.path(key), got=_excerpt(value), expected="a table")
        return Values(value, f"{self.path(key)}.")

    def text(self, key: str, default: str | None = None) -> str:
        """The text of a key, or a default."""
        value = self._values.get(key, default)
        if not isinstance(value, str):
            raise ConfigError(self.path(key), got=_excerpt(value), expected="text")
        return value.strip()

    def number(self, key: str, default: float | None = None) -> float:
        """A finite number, or a default."""
        if default is not None and key not in self._values:
            return default
        return self._checked(key, self._values.get(key))

    def positive(self, key: str) -> float:
        """A number above 0."""
        value = self.number(key)
        if value <= 0:
            raise ConfigError(self.path(key), got=f"{value:g}", expected="more than 0")
        return value

    def size_px(self, key: str) -> int:
        """A whole number of pixels."""
        value = self.number(key)
        if not (value == int(value) and 0 < value <= _MAX_SIZE_PX):
            raise ConfigError(self.path(key), got=f"{value:g}", expected=f"whole pixels, 1 to {_MAX_SIZE_PX}")
        return int(value)

    def numbers(self, key: str, count: int | None = None) -> tuple[float, ...]:
        """Numbers of a list, of lists in a list, or of a table's ``data``, in their order.

        Args:
            key: The key.
            count: How many are expected; None for any number.
        """
        value = self._values.get(key)
        value = value.get("data") if isinstance(value, Mapping) else value
        if not isinstance(value, list):
            raise ConfigError(self.path(key), got=_excerpt(value), expected="a list of numbers")
        rows = [each if isinstance(each, list) else [each] for each in value]
        found = tuple(self._checked(key, each) for row in rows for each in row)
        if count is not None and len(found) != count:
            raise ConfigError(self.path(key), got=counted(len(found), "number"), expected=f"{count}")
        return found

    def _checked(self, key: str, value: object) -> float:
        try:
            number = math.nan if isinstance(value, bool) else float(value)  # type: ignore[arg-type]  # of any kind
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        if not abs(number) <= LARGEST:
            raise ConfigError(self.path(key), got=_excerpt(value), expected="a finite number")
        return number


def only_table(tables: Mapping[str, Any], path: str = "") -> Values:
    """The one camera of a file.

    Raises:
        ConfigError: It has none, or several.
    """
    if len(tables) != 1:
        hint = "keep one of them in a copy of the file" if tables else "give a file that holds a camera"
        raise ConfigError("its cameras", got=counted(len(tables), "camera"), expected="one", hint=hint)
    return Values(tables, path).table(next(iter(tables)))


def refused_model(key: str, model: str, known: Iterable[str]) -> ConfigError:
    """The refusal of a lens model that aerodft does not have."""
    hint = f"calibrate with one of these, then give that file or {_COPY}"
    return ConfigError(key, got=f"the lens model {_excerpt(model)}", expected=" or ".join(known), hint=hint)


def refuse_unless_zero(values: Values, keys: Iterable[str]) -> None:
    """Refuse coefficients that aerodft's lens models do not have.

    Raises:
        ConfigError: One is not zero.
    """
    for key in keys:
        if value := values.number(key, 0.0):
            hint = f"calibrate without it, then give that file or {_COPY}"
            raise ConfigError(values.path(key), got=f"{value:g}", expected="0: no lens model here has it", hint=hint)


def named_distortion(lens: LensModel, coefficients: Mapping[str, float]) -> tuple[float, ...]:
    """Distortion coefficients in the order of camera files, by OpenCV's names; those that are not named are 0."""
    return tuple(coefficients.get(name, 0.0) for name in lens.coefficients)


def camera_keys(
    size_px: tuple[int, int],
    matrix: tuple[float, float, float, float],
    lens: LensModel,
    distortion: Sequence[float],
    key: str,
) -> dict[str, Any]:
    """Keys of a camera file.

    Args:
        size_px: Width and height.
        matrix: fx, fy, cx, cy in pixels; the centre of the top-left pixel is (0, 0).
        lens: The lens model.
        distortion: Its coefficients in OpenCV's order; trailing ones may be left out.
        key: Path of the distortion's key, for sentences.

    Raises:
        ConfigError: Coefficients that the model does not have, or a calibration of another image size.
    """
    for axis, centre_px, length_px in zip(("cx", "cy"), matrix[2:], size_px, strict=True):
        if abs(centre_px - (length_px - 1) / 2) > _MAX_CENTRE_OFFSET * length_px:
            got = f"{centre_px:g} px in an image of {size_px[0]} x {size_px[1]} px"
            expected = f"within {100 * _MAX_CENTRE_OFFSET:.0f} % of the image's centre"
            hint = f"if the image is a crop of a larger one, {_COPY}"
            raise ConfigError(f"principal point {axis}", got=got, expected=expected, hint=hint)
    most = max(lens.coefficient_counts)
    used = max((at for at, value in enumerate(distortion, 1) if value), default=0)
    if used > most:
        got, expected = f"{used} coefficients", f"at most {most} that are not 0 for a {lens} lens"
        raise ConfigError(key, got=got, expected=expected, hint=f"calibrate with fewer, or {_COPY}")
    count = next(each for each in lens.coefficient_counts if each >= used)
    names = ("fx_px", "fy_px", "cx_px", "cy_px")
    return {
        "width_px": size_px[0],
        "height_px": size_px[1],
        **dict(zip(names, matrix, strict=True)),
        "lens": str(lens),
        "distortion": [*distortion, *[0.0] * count][:count],
    }


def _excerpt(value: object) -> str:
    """A value in a few words; of lists and tables no content, which aliases of YAML make as long as they like."""
    if value is None:
        return "nothing"
    if not isinstance(value, str | int | float):
        return "a table" if isinstance(value, Mapping) else "a list"
    text = repr(value)
    return text if len(text) <= _MAX_SHOWN else f"{text[: _MAX_SHOWN - 4]}..."
