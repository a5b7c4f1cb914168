"""aerodft turns aerial images and telemetry into measurements with an honest uncertainty."""

__version__ = "0.1.0"
