"""What a vehicle says of its own health, and what follows for a pose."""

from aerodft.service.health.sources import HealthSources
