"""The engine: Depth from Triangulation, by the book (``dft``) and by the pinhole, with joint uncertainty."""
