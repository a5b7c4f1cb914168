"""``aerodft depth-map``: range and ground point of every pixel, and an image as it is seen from above."""

from pathlib import Path
from typing import Annotated

import typer

from aerodft.cli.options import JsonOption, grouped
from aerodft.cli.scenes.image_options import GroundOptions, SurfaceOptions
from aerodft.cli.scenes.measure import DepthOptions, ModelOption, RecordedOptions, measure_image


@grouped
def depth_map(
    ground: GroundOptions,
    scene: SurfaceOptions,
    recorded: RecordedOptions,
    *,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write to.")],
    model: ModelOption = None,
    image: Annotated[Path | None, typer.Option(help="The image, to be seen from straight above.")] = None,
    step: Annotated[float | None, typer.Option(help="With --image: step of the view from above, m.")] = None,
    json: JsonOption = False,
) -> None:
    r"""Write range, ground point and sampling distance of every pixel, to 100 heights away, and the image's outline.

    \b
    Example:
      aerodft depth-map --camera configs/cameras/canon-1000d.toml --height 10.48 --tilt 75 \
        --lat 48.1 --lon 11.5 -o depth
    """
    mapped = DepthOptions(depth_map=output, image=image, step=step)
    measure_image(ground, scene, recorded, model, None, mapped, compare=False, explain=False, as_json=json)
