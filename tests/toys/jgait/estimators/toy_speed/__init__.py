"""A toy: the distance of a person who walks at one speed while the sensor at the waist measures.

Deviations from the paper:
    1. There is no paper.

Sensors:
    One at the waist.

Outputs:
    The distance over time.
"""

from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np
from jgait.estimators.toy_speed.about import ABOUT

from jgait import params
from jgait.estimators.interface import Estimator, Prepared, Sampled, Times, with_measures
from jgait.geometry.arrays import xp
from jgait.types import Estimate, Legs, Recording, RecordingError


@params.documented
class ToyParams(NamedTuple):
    """Parameters of the toy."""

    toy_speed: Annotated[Any, params.Parameter(params.positive, "m/s", "of walking")] = 1.2


class ToyInputs(NamedTuple):
    """The samples, (T,) each.

    Attributes:
        time: [s].
        dt: since the sample before; 0 at the first and in padding [s].
        valid: False in padding.
    """

    time: Times
    dt: Sampled
    valid: Sampled


def prepare(recording: Recording) -> Prepared[ToyInputs]:
    """The times of the sensor at the waist."""
    if "waist" not in recording.sensors:
        raise RecordingError(f"toy_speed needs a sensor at the waist; the recording has {list(recording.sensors)}")
    time = np.asarray(recording.sensors["waist"].time)
    return Prepared(ToyInputs(time, np.diff(time, prepend=time[0]), np.ones(time.shape, bool)), None, ())


def run(p: ToyParams, inputs: ToyInputs, options: None = None) -> Estimate:
    """The distance at one speed: pure, for jit, vmap and grad."""
    return Estimate(inputs.time, Legs(None, None), None, p.toy_speed * xp.cumsum(inputs.dt), inputs.valid, {})


def estimator() -> Estimator[ToyParams, ToyInputs]:
    """The toy as a record of functions."""
    with_body = partial(with_measures, "toy_speed", ("toy_speed",))
    return Estimator("toy_speed", ToyParams(), prepare, run, with_body, ABOUT)
