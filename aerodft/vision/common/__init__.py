"""Points tracked between images, and the keyframes that images are compared with."""
