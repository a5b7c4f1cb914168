"""Values only: frozen, without I/O, in SI units and radians."""
