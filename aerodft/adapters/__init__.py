"""What touches the world: telemetry, images, recordings, configuration, the bus; one package each."""
