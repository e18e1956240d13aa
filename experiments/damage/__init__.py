"""Damaged input and interrupted commands: readers on mutated files, and folders of results after a kill."""

PARTS = ("signals", "fuzz", "killed")
