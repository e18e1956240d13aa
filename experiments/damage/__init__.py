"""Damaged input and interrupted commands: signals, files, and folders of results after a kill."""

PARTS = ("signals", "undamaged", "gaps", "coverage", "fuzz", "killed")
