"""The bus: measurements published, questions answered, observations taken, over zenoh."""
