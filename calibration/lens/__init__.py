"""The lens from images of a board: detection, choice of views, joint adjustment, and how well it is known."""
