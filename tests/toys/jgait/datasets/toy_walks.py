"""`toy_walks`: a toy set, files `NAME.toy` with a reference of 1.2 m/s."""

from pathlib import Path

import numpy as np

from jgait import io
from jgait.datasets import registry
from jgait.types import Estimate, Legs, Walk


def names() -> list[str]:
    """Names of the files without their ending."""
    return [Path(file).stem for file in registry.listing("toy_walks", "", "*.toy")]


def load_one(name: str) -> Walk:
    """One walk and its distance."""
    path, known = registry.file("toy_walks", f"{name}.toy")
    recording = io.read(path, name=name, subject=name)
    time = np.asarray(recording.sensors["waist"].time)
    reference = Estimate(time, Legs(None, None), None, 1.2 * (time - time[0]), np.ones(time.shape, bool), {})
    return Walk(recording, reference, {"verified": known})
