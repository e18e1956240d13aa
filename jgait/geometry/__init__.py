"""Vectors, rotations and rigid segments, by NumPy or JAX; elementwise over time and people."""
