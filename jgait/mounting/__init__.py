"""Orientation of a sensor on the body, from standing and walking."""
