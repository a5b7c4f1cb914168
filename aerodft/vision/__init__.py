"""Images to pixels: what stands still in them."""
