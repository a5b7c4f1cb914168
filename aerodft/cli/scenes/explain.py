"""``aerodft explain``: where an uncertainty comes from, and how far the two projection models are apart."""

from typing import Annotated, Any

import typer

from aerodft.cli.scenes.image_options import with_options_of
from aerodft.cli.scenes.measure import measure


@with_options_of(measure, "depth_map", "image", "step", "explain")
def explain(
    *,
    compare: Annotated[
        bool,
        typer.Option(
            "--compare",
            rich_help_panel="Uncertainty and model",
            help="Both projection models side by side, and what lies between.",
        ),
    ] = False,
    **shared: Any,  # noqa: ANN401 - the options of measure, which it checks
) -> None:
    r"""Say where the uncertainty of a measurement comes from, and what would make it smaller.

    \b
    Examples:
      aerodft explain --camera configs/cameras/canon-1000d.toml --height 10.48 --tilt 67 \
        --probe "range 1944,493"
      aerodft explain --recording demo/recording --at 5 --probe "distance 200,300 500,300" --compare
    """
    measure(**shared, compare=compare, explain=not compare)
