"""The toy at its own speed."""

from experiments.common.row import Row
from jgait.estimators import toy_speed


def rows(quick: bool) -> list[Row]:
    """The one parameter of the toy."""
    return [Row("toy_speed_mps", toy_speed.ToyParams().toy_speed, "m/s")]
