"""``aerodft explain``: where an uncertainty comes from, and how far the two projection models are apart."""

from typing import Annotated

import typer

from aerodft.cli.options import JsonOption, grouped
from aerodft.cli.scenes.image_options import GroundOptions, SurfaceOptions
from aerodft.cli.scenes.measure import ModelOption, ProbeOption, RecordedOptions, measure_image


@grouped
def explain(
    ground: GroundOptions,
    scene: SurfaceOptions,
    recorded: RecordedOptions,
    *,
    model: ModelOption = None,
    probe: ProbeOption = None,
    compare: Annotated[
        bool,
        typer.Option(
            "--compare",
            rich_help_panel="Uncertainty and model",
            help="Both projection models side by side, and what lies between.",
        ),
    ] = False,
    json: JsonOption = False,
) -> None:
    r"""Say where the uncertainty of a measurement comes from, and what would make it smaller.

    \b
    Examples:
      aerodft explain --camera configs/cameras/canon-1000d.toml --height 10.48 --tilt 67 \
        --probe "range 1944,493"
      aerodft explain --recording demo/recording --at 5 --probe "distance 200,300 500,300" --compare
    """
    measure_image(ground, scene, recorded, model, probe, compare=compare, explain=not compare, as_json=json)
