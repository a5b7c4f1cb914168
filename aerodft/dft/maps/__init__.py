"""Every pixel of an image on the ground: depth, its standard deviation, orthophotos."""
