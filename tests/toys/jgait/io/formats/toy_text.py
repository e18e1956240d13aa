"""A toy format: a line `toy RATE`, then gyroscope [rad/s] and accelerometer [m/s²] of a sensor at the waist."""

from pathlib import Path

import numpy as np

from jgait.io.part import Measured, Part


def recognises(path: Path, head: bytes) -> bool:
    """Whether the first line begins with `toy`."""
    return head.startswith(b"toy ")


def measured(path: Path) -> Measured:
    """The one sensor of a file."""
    first, *lines = path.read_text(encoding="utf-8").splitlines()
    values = np.array([[float(word) for word in line.split()] for line in lines])
    rate = float(first.split()[1])
    part = Part("waist", values[:, :3], values[:, 3:], None, rate, "rad/s", "m/s^2", "waist")
    return Measured([part], path.stem)
