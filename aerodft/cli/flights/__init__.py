"""Commands about flights: live, imported, aligned, diagnosed."""
