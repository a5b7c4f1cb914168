"""Banks of a river as observations: what a probe of kind ``river`` is measured from, while images come."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from aerodft.dft.request import Setup
from aerodft.dft.zoomed import zoomed
from aerodft.model.camera import Camera
from aerodft.model.image import Image
from aerodft.model.observation import VISION, Observation
from aerodft.model.pose import PoseSample
from aerodft.model.probe import Probe
from aerodft.vision.river import NoRiver, River, RiverQuestion, RiverStatus, find_river

MOST_TRANSECTS: Final = 32
_DECIMALS: Final = 3
_LEAST_STD_PX: Final = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class RiverLook:
    """How banks are looked for.

    Attributes:
        every_s: Least time between two looks; 0 for every image.
        spacing_m: Of the transects; up to 32 of them, evenly chosen, become one observation.
        seed_px: A pixel in the water of every image; None for the lower middle.
        max_range_m: Water farther than this is left out; None for 12 camera heights.
    """

    every_s: float = 1.0
    spacing_m: float = 1.0
    seed_px: tuple[float, float] | None = None
    max_range_m: float | None = None


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
        look: RiverLook,
        probes: tuple[Probe, ...],
        pose_near: Callable[[Image], PoseSample | None],
    ) -> None:
        self.misses: Counter[str] = Counter()
        self._camera, self._look, self._probes, self._pose_near = camera, look, probes, pose_near

    def observe(self, image: Image) -> tuple[Observation, ...]:
        """The banks in one image; nothing where there is no river, or no pose yet.

        Raises:
            AerodftError: The pixels cannot be read.
        """
        if image.pixels is None:
            return ()
        sample = self._pose_near(image)
        if sample is None or sample.pose is None:
            self.misses["NO_POSE"] += 1
            return ()
        seen = []
        for probe in self._probes:
            setup = Setup(camera=self._camera, elevation_m=probe.elevation_m, max_range_m=self._look.max_range_m)
            setup, sample = zoomed(setup, sample)
            assert sample.pose is not None  # noqa: S101 - as above, for the type checker
            question = RiverQuestion(seed_px=self._look.seed_px, spacing_m=self._look.spacing_m)
            found = find_river(image.pixels(), setup, sample.pose, question)
            if isinstance(found, NoRiver):
                self.misses[str(found.status)] += 1
            elif observation := _observed(found, probe.name, image):
                seen.append(observation)
        return tuple(seen)


def _observed(found: River, name: str, image: Image) -> Observation | None:
    rows = np.array([row for row, status in enumerate(found.status) if status is RiverStatus.OK], dtype=np.int64)
    if len(rows) == 0:
        return None
    chosen = rows[np.unique(np.rint(np.linspace(0, len(rows) - 1, min(len(rows), MOST_TRANSECTS))).astype(np.int64))]
    pixels = np.round(found.edges.pixels_px[chosen].reshape(-1, 2), _DECIMALS).tolist()
    spread_px = float(np.sqrt(np.mean(np.square(found.edges.std_px[chosen]))))
    return Observation(
        name=name,
        stamp_ns=image.stamp_ns,
        arrival_ns=image.arrival_ns,
        pixels=tuple((u, v) for u, v in pixels),
        std_px=round(float(np.hypot(spread_px, _LEAST_STD_PX)), _DECIMALS),
        clock=image.clock,
        image=image.index,
        source=VISION,
    )
