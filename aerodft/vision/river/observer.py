"""A river's banks in images while they come: observations that a probe of kind ``river`` is measured from."""

from collections import Counter
from collections.abc import Callable
from typing import Final

import numpy as np

from aerodft.dft import Setup, zoomed
from aerodft.model import Camera, Image, Observation, PoseSample, Probe
from aerodft.service import RiverSettings
from aerodft.vision.river.find import River, RiverQuestion, find_river
from aerodft.vision.river.status import WHY, NoRiver, RiverStatus
from aerodft.vision.river.water import RiverHints, WaterPlane

MOST_OBSERVED: Final = 32
_DECIMALS: Final = 3
_LEAST_STD_PX: Final = 0.3


class RiverObserver:
    """Implements ``service.ports.ImageObserver``: pairs of bank pixels, left then right, for each river probe.

    Transects are laid with a pose of about the same time; widths are measured from the image's own.

    Args:
        camera: The camera.
        look: How banks are looked for.
        probes: Those of kind ``river``.
        pose_near: The pose of about an image's time; None where there is none.

    Attributes:
        misses: How many looks found no river, by status.
    """

    def __init__(
        self,
        camera: Camera,
        look: RiverSettings,
        probes: tuple[Probe, ...],
        pose_near: Callable[[Image], PoseSample | None],
    ) -> None:
        self.misses: Counter[str] = Counter()
        self._first: WaterPlane | None = None
        self._camera, self._look, self._probes, self._pose_near = camera, look, probes, pose_near

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """The banks in one image; of each probe why there are none, where there is no river, or no pose yet.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        if image.pixels is None:
            return ()
        sample = self._pose_near(image)
        if sample is None or sample.pose is None:
            return tuple(
                self._missed(probe, image, "NO_POSE", "where the camera looks was not known yet")
                for probe in self._probes
            )
        seen = []
        for probe in self._probes:
            setup = Setup(camera=self._camera, elevation_m=probe.mean_elevation_m, max_range_m=self._look.max_range_m)
            setup, sample = zoomed(setup, sample)
            assert sample.pose is not None  # noqa: S101 - as above, for the type checker
            hints = self._hints(WaterPlane.from_setup(setup, sample.pose))
            question = RiverQuestion(hints=hints, spacing_m=self._look.spacing_m)
            found = find_river(image.pixels(), setup, sample.pose, question)
            if isinstance(found, NoRiver):
                seen.append(self._missed(probe, image, found.status, found.reason))
            elif observation := _observed(found, probe.name, image):
                seen.append(observation)
            else:
                seen.append(self._missed(probe, image, *_commonest(found)))
        return tuple(seen)

    def _hints(self, plane: WaterPlane) -> RiverHints:
        """What is said of every image, and of the first one, carried to where its places are seen now."""
        told = RiverHints(self._look.hints.water_px, self._look.hints.land_px)
        if self._first is None:
            self._first = plane
        carried = told.carried(self._first, plane)
        of_each = [] if self._look.seed_px is None else [self._look.seed_px]
        return RiverHints([*carried.water, *of_each], carried.land)

    def _missed(self, probe: Probe, image: Image, code: str, reason: str) -> Observation:
        self.misses[str(code)] += 1
        return Observation.in_image(image, probe.name, unseen=f"{code}: {reason}")


def _commonest(found: River) -> tuple[str, str]:
    """Why no transect has a width: what is said of most of them, as a code and a sentence."""
    status, _ = Counter(found.status).most_common(1)[0]
    return status, WHY[status]


def _observed(found: River, name: str, image: Image) -> Observation | None:
    rows = np.array([row for row, status in enumerate(found.status) if status is RiverStatus.OK], dtype=np.int64)
    if len(rows) == 0:
        return None
    chosen = rows[np.unique(np.rint(np.linspace(0, len(rows) - 1, min(len(rows), MOST_OBSERVED))).astype(np.int64))]
    pixels = np.round(found.edges.pixels_px[chosen].reshape(-1, 2), _DECIMALS).tolist()
    spread_px = float(np.sqrt(np.mean(np.square(found.edges.std_px[chosen]))))
    std_px = round(float(np.hypot(spread_px, _LEAST_STD_PX)), _DECIMALS)
    return Observation.in_image(image, name, tuple((u, v) for u, v in pixels), std_px=std_px)
