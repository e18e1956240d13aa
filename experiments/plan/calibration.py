"""Errors of the sensors on shoes from a walk: scales and biases, as further states of the foot's filter.

Gyroscope and accelerometer read (1 + s_g) ω + b_g and (1 + s_a) f + b_a, with a scale and a bias of each axis. A foot
that stands has no velocity, and on level ground the height of the last foothold, so that every stride must close: a
wrong scale of the rates turns gravity to where it is not, a wrong scale or bias of the forces leaves a velocity or a
height. What the strides do not show keeps its prior.

`plan.calibrated` measures it: less than half of the effect of planted errors on strides is removed in simulation, and
none on public walks, whose strides it changes by a centimetre without any planted error. So it is no part of jgait.
"""

from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, PyTree

from jgait import filtering
from jgait.estimators.foot_ins import model as foot_model
from jgait.estimators.foot_ins.estimator import CONSTANT_VELOCITY_S, controls, estimator, model_params, prior_of
from jgait.estimators.foot_ins.model import FootControl, FootModelParams, FootObservation, FootState
from jgait.estimators.foot_ins.params import FootParams
from jgait.estimators.foot_ins.prepare import FootSignals
from jgait.estimators.interface import pad
from jgait.estimators.programs import bucket, compiled
from jgait.filtering import Belief, Covariance, Model
from jgait.geometry.rotation import differences, retract
from jgait.geometry.vectors import GRAVITY, Three
from jgait.notes import record
from jgait.types import SIDES, AnyArray, Recording, RecordingError, Values, as_float

if TYPE_CHECKING:
    import pandas as pd

FEWEST_STRIDES = 10
"""[1] Least number of strides of a foot; fewer strides show nothing beside their noise; chosen."""

SHOWN = 0.7
"""[1] Largest deviation after the walk over that before it with which the walk shows an error; chosen."""

LEVEL_M = 0.1
"""[m] Median rise or fall of a stride from which on the ground is not taken as level: half a step of stairs."""


@record
class SensorErrors(NamedTuple):
    """Errors of a sensor, or their standard deviations: each axis (3,), or one number for all."""

    gyr_scale: Values  #: [1]
    acc_scale: Values  #: [1]
    gyr_bias: Values  #: [rad/s]
    acc_bias: Values  #: [m/s²]


UNCALIBRATED = SensorErrors(0.02, 0.02, 0.01, 0.3)
"""Deviations of errors before a walk is seen: those of sensors as they are sold, after their bias was measured at rest.
Data sheets of inertial sensors on chips state tolerances of ±1 to ±3 % of scale and ±.4 to ±.8 m/s²."""


@record
class Calibration(NamedTuple):
    """Errors of the sensors on shoes, made by `calibrate`.

    Attributes:
        errors: placement → errors of its sensor.
        stddev: placement → their standard deviations.
        prior: deviations before the walk.
        level: whether the ground was taken as level.
    """

    errors: dict[str, SensorErrors]
    stddev: dict[str, SensorErrors]
    prior: SensorErrors
    level: bool

    def applied(self, recording: Recording) -> Recording:
        """A recording of the same sensors without these errors; lost samples stay as they are."""
        sensors = dict(recording.sensors)
        for name, e in self.errors.items():
            imu, there = sensors[name], np.asarray(sensors[name].mask, bool)[:, None]
            gyr, acc = as_float(imu.gyr), as_float(imu.acc)
            sensors[name] = imu._replace(
                gyr=np.where(there, (1.0 - e.gyr_scale) * gyr - e.gyr_bias, gyr),
                acc=np.where(there, (1.0 - e.acc_scale) * acc - e.acc_bias, acc),
            )
        return recording._replace(sensors=sensors)

    def to_dataframe(self) -> "pd.DataFrame":
        """A row for each error of each axis: value, deviation, that before the walk, and whether the walk shows it."""
        import pandas as pd

        rows = [
            (name, error, axis, value, spread, before, spread < SHOWN * before)
            for name, errors in self.errors.items()
            for error, values, spreads, before in zip(
                errors._fields, errors, self.stddev[name], self.prior, strict=True)
            for axis, value, spread in zip("xyz", values, spreads, strict=True)
        ]  # fmt: skip
        return pd.DataFrame(rows, columns=["placement", "error", "axis", "value", "stddev", "prior", "shown"])


class CalibratedState(NamedTuple):
    """A `FootState` or a `FootError`, and the scale errors of its sensor [1] or their errors."""

    position: Three | Values
    velocity: Three | Values
    attitude: Three | Values | Float[AnyArray, "*batch 4"]
    gyr_bias: Three | Values
    acc_bias: Three | Values
    gyr_scale: Three | Values
    acc_scale: Three | Values


def _free(s: CalibratedState, u: FootControl) -> tuple[FootState, FootControl]:
    """The motion, and the readings without errors of scale."""
    return FootState(*s[:5]), u._replace(gyr=(1.0 - s.gyr_scale) * u.gyr, acc=(1.0 - s.acc_scale) * u.acc)


def transition(p: FootModelParams, s: CalibratedState, u: FootControl, dt: Values) -> CalibratedState:
    """Strapdown of the sensor without its errors of scale, which are constant."""
    return CalibratedState(*foot_model.transition(p, *_free(s, u), dt), *s[5:])


def transition_noise(p: FootModelParams, s: CalibratedState, u: FootControl, dt: Values) -> Covariance:
    """Process noise of the foot's model."""
    noise = foot_model.transition_noise(p, FootState(*s[:5]), u, dt)
    crossed = {("position", "velocity"): noise["position", "velocity"]}
    return Covariance.from_variances(CalibratedState(*noise.variances(), 0.0, 0.0)).with_entries(crossed)


def observation(p: FootModelParams, s: CalibratedState, u: FootControl) -> FootObservation:
    """Velocity about the pivot, and height over the last foothold, both zero."""
    return foot_model.observation(p, *_free(s, u))


def local(reference: CalibratedState, s: CalibratedState) -> CalibratedState:
    """The error of the state `s` relative to `reference`."""
    return CalibratedState(*differences(reference, s))


MODEL = Model(
    foot_model.initial, transition, transition_noise, observation, foot_model.observation_noise, retract, local
)
"""The foot's model with errors of scale; its belief at the start is that of `_of_foot`."""


def _of_foot(p: FootParams, foot: FootSignals, time: Values, prior: SensorErrors, level: bool) -> PyTree:
    """State and variances after the walk, of the filter in which a zero velocity counts once in
    `CONSTANT_VELOCITY_S`.
    """
    number = jnp.floor(time / CONSTANT_VELOCITY_S)
    stands = foot.stands & foot.valid & (number != jnp.concatenate([number[:1] - 1.0, number[:-1]]))
    foothold = jnp.concatenate([foot.restart[1:], foot.restart[:1]]) > 0.0
    near = CONSTANT_VELOCITY_S * jnp.sum(jnp.sign(foot.dt)) / jnp.maximum(jnp.sum(foot.dt), CONSTANT_VELOCITY_S)
    less = jnp.sqrt(jnp.maximum(near, 1.0))  # of the mean of all samples for which one counts
    q = p._replace(velocity_noise=p.velocity_noise / less, rate_noise=p.rate_noise / less)
    start, zero = prior_of(p, foot), jnp.zeros_like(foot.gyr)
    nothing = jnp.zeros_like(foot.gyr_bias)
    known = [jnp.broadcast_to(variance, 3) for variance in start.cov.variances()[:3]]
    doubts = [jnp.broadcast_to(jnp.asarray(sd, zero.dtype) ** 2, 3)
              for sd in (prior.gyr_bias, prior.acc_bias, prior.gyr_scale, prior.acc_scale)]  # fmt: skip
    initial = Belief(
        CalibratedState(*start.mean, nothing, nothing), Covariance.from_variances(CalibratedState(*known, *doubts))
    )
    after = filtering.infer(
        MODEL, model_params(p), FootObservation(zero, zero[:, 0]), smooth=False, controls=controls(q, foot),
        dt=foot.dt, mask=FootObservation(stands, foot.stands & foot.valid & foothold if level else False),
        initial=initial, keep=("mean", "cov"), execution="core",
    ).filtered.belief(-1)  # fmt: skip
    return after.mean, after.cov.variances()


def calibrate(recording: Recording, prior: SensorErrors = UNCALIBRATED) -> Calibration:
    """Errors of the sensors on shoes from a recording in which the person stands and walks.

    On level ground the strides' heights are used as well; otherwise fewer errors are shown.

    Args:
        recording: with sensors on one or both feet, `FEWEST_STRIDES` of each or more.
        prior: standard deviations of the errors before the walk is seen.

    Raises:
        RecordingError: as `foot_ins`, too few strides, or a walk that shows none of the errors.
    """
    made, params = estimator(), FootParams()
    prepared = made.prepared(recording)
    strides = made.finished(made.computed(params, prepared), prepared).strides
    level = abs(float(np.median(as_float(strides.height)[np.asarray(strides.valid, bool)]))) < LEVEL_M
    inputs = pad(prepared.inputs, bucket(len(prepared.inputs.time)))
    errors, stddev = {}, {}
    for side, foot in zip(SIDES, (inputs.right, inputs.left), strict=True):
        if foot is None:
            continue
        name, count = f"foot_{side}", int(np.sum(np.asarray(strides.valid) & (strides.side == SIDES.index(side))))
        if count < FEWEST_STRIDES:
            raise RecordingError(f"'{name}' has {count} strides; its errors need {FEWEST_STRIDES} or more")
        mean, variance = compiled(_of_foot)(params, foot, inputs.time, prior, level=level)
        # `prepare` has scaled the force at rest to gravity already
        scale = (1.0 + float(foot.acc_bias @ foot.up) / GRAVITY) / (1.0 + prepared.quality[name].force_off)
        acc_scale = 1.0 - scale * (1.0 - np.asarray(mean.acc_scale))
        errors[name] = SensorErrors(
            np.asarray(mean.gyr_scale), acc_scale, np.asarray(mean.gyr_bias), np.asarray(mean.acc_bias)
        )
        stddev[name] = SensorErrors(*(np.sqrt(getattr(variance, error)) for error in SensorErrors._fields))
    found = Calibration(errors, stddev, prior, level)
    if not any(np.any(sd < SHOWN * before) for sds in stddev.values() for sd, before in zip(sds, prior, strict=True)):
        raise RecordingError(f"the walk shows none of the errors: no deviation is below {SHOWN:g} of that before it")
    return found
