"""fillers."""
