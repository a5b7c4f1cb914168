"""Two recordings side by side: the same measurements, and how far apart they are."""
