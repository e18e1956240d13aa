"""Predicted errors beside real ones, shares beside finite differences, and sensors calibrated from a walk."""

PARTS = ("degraded", "explained", "calibrated")
