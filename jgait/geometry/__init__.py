"""Vectors, rotations and rigid segments; elementwise over time and people."""
