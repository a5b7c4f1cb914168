"""How a camera turned between images, and whether a fixed one was bumped."""
