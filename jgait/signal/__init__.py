"""Filters and moving statistics of sampled signals."""
