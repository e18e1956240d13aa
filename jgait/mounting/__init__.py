"""mounting."""
