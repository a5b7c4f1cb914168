"""Where a run's measurements go beside its recording: a registry of outputs, each with a table of the configuration."""

from aerodft.adapters.outputs.output import Output, OutputKind, Run
from aerodft.adapters.outputs.registry import OUTPUTS, default_outputs, open_outputs, outputs_document, outputs_from
