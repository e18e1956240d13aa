"""Orientation of a sensor on the body, from standing and walking."""

from jgait.mounting.places import SagittalRate, sagittal_rate

__all__ = ["SagittalRate", "sagittal_rate"]
