"""The lens from images of a board: detection, choice of views, joint adjustment, and how well it is known."""

from calibration.lens.adjustment import BoardView, intrinsics_of
from calibration.lens.board import (
    DEFAULT_CHARUCO,
    Board,
    BoardFinder,
    dictionary,
    dictionary_names,
    draw_board,
    parse_board,
    suggestion,
)
from calibration.lens.solution import (
    LensChoice,
    LensFit,
    choose,
    covered_cells,
    distortion_px,
    missing,
    ray_std_px,
    solve_lens,
)
