"""Strides counted and measured from one sensor at the ankle (Silva, Afonso and Rocha 2017)."""

PARTS = ("detection", "methods", "lever", "sweeps", "online", "routes", "states")
