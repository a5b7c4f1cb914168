"""Pure array functions: rotations, lens, rays, ground, geodesy, interpolation. Batch-first, no I/O, no state."""
