"""``python -m aerodft``."""

from aerodft.cli.main import main

main()
