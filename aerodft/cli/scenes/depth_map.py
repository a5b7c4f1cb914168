"""``aerodft depth-map``: range and ground point of every pixel, and an image as it is seen from above."""

from pathlib import Path
from typing import Annotated, Any

import typer

from aerodft.cli.scenes.image_options import with_options_of
from aerodft.cli.scenes.measure import measure


@with_options_of(measure, "depth_map", "probe", "compare", "explain")
def depth_map(
    *,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write to.")],
    image: Annotated[Path | None, typer.Option(help="The image, to be seen from straight above.")] = None,
    step: Annotated[float | None, typer.Option(help="With --image: step of the view from above, m.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print what was found and written as JSON.")] = False,
    **shared: Any,  # noqa: ANN401 - the options of measure, which it checks
) -> None:
    r"""Write range, ground point and sampling distance of every pixel, to 100 heights away, and the image's outline.

    \b
    Example:
      aerodft depth-map --camera configs/cameras/canon-1000d.toml --height 10.48 --tilt 75 \
        --lat 48.1 --lon 11.5 -o depth
    """
    measure(**shared, depth_map=output, image=image, step=step, json=json)
