"""Stride width from two feet (Potter, Liu, Selamet and Kumaravelu): Table I in simulation, and a real walk."""

PARTS = ("gaitmap_example", "table1")
