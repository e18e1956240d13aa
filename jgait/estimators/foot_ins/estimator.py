"""From prepared inputs to foot paths and strides."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jgait import filtering, params
from jgait.estimators.foot_ins import model as foot_model
from jgait.estimators.foot_ins import readout as foot_strides
from jgait.estimators.foot_ins.about import ABOUT
from jgait.estimators.foot_ins.inputs import FootInputs, FootSignals, pad
from jgait.estimators.foot_ins.model import (
    FootControl,
    FootError,
    FootModelParams,
    FootObservation,
    FootState,
    FootVelocity,
)
from jgait.estimators.foot_ins.params import DEFAULT, TEXTBOOK, TRANSFORMS, FootOptions, FootParams, with_body
from jgait.estimators.foot_ins.prepare import Preparation, level, prepare
from jgait.estimators.foot_ins.readout import Path
from jgait.estimators.foot_ins.windows import WINDOW, joined, windows
from jgait.estimators.interface import Estimator, Prepared, bucket
from jgait.filtering import Belief, Covariance
from jgait.geometry.rotation import Quaternion
from jgait.geometry.vectors import Vector, vector
from jgait.types import SIDES, Estimate, Feet, FootTrajectory, Legs, Recording

BUCKET = 1024
"""Recordings are padded to this many samples times a power of two, so that few programs are compiled."""

LONG = 2**15
"""[samples] From here on "auto" smooths over components: ten times as fast, after twice as long a compilation."""

__all__ = [
    "DEFAULT",
    "TEXTBOOK",
    "TRANSFORMS",
    "FootOptions",
    "FootParams",
    "estimate",
    "estimator",
    "prepared",
    "run",
    "with_body",
]


def model_params(p: FootParams) -> FootModelParams:
    """The model's parameters."""
    return FootModelParams(p.pivot_height, p.gyr_bias_walk**2, p.acc_bias_walk**2, p.height_noise**2)


def controls(p: FootParams, foot: FootSignals) -> FootControl:
    """What the sensor reads, and how far to trust it: an error white over an interval h has the density σ² h."""
    h = foot.dt
    return FootControl(
        gyr=vector(foot.gyr),
        acc=vector(foot.acc),
        gyr_density=p.gyr_noise**2 + ((p.gyr_jump_noise * foot.gyr_jump) ** 2 + foot.gyr_doubt**2) * h,
        acc_density=p.acc_noise**2 + ((p.acc_jump_noise * foot.acc_jump) ** 2 + foot.acc_doubt**2) * h,
        velocity_variance=p.velocity_noise**2 + (p.rate_noise * foot.rate) ** 2,
        restart=foot.restart,
    )


def prior_of(p: FootParams, foot: FootSignals) -> Belief:
    """The belief at the first stance: level, at rest, the gyroscope's bias as it was read at rest.

    Gravity corrects a bias about horizontal axes and nothing one about the vertical: there a foot that turned unseen
    while it seemed to rest would count, so the bias is known best about the vertical.
    """
    dtype = foot.gyr.dtype
    zero = jnp.zeros((), dtype)
    tilt, still = jnp.asarray(p.tilt, dtype) ** 2, jnp.asarray(1e-6, dtype)
    vertical = p.gyr_bias**2 + (p.sway / foot.still_time) ** 2
    level = jnp.maximum(vertical, p.gyr_bias_tilt**2)
    up = vector(foot.up)
    bias = {
        (f"gyr_bias.{a}", f"gyr_bias.{b}"): (level if a == b else 0.0)
        + (vertical - level) * getattr(up, a) * getattr(up, b)
        for a, b in ("xx", "xy", "xz", "yy", "yz", "zz")
    }
    variances = FootError(
        position=Vector(zero + foot_model.AGAIN, zero + foot_model.AGAIN, zero + foot_model.AGAIN),
        velocity=Vector(100.0 * still, 100.0 * still, 100.0 * still),
        attitude=Vector(tilt, tilt, 1e-2 * still),
        gyr_bias=Vector(zero, zero, zero),
        acc_bias=Vector(*(zero + p.acc_bias**2 + jnp.sum(foot.acc_bias**2),) * 3),
    )
    attitude = Quaternion(*(foot.attitude[i] for i in range(4)))
    belief = foot_model.standing_belief(attitude, vector(foot.gyr_bias), variances)
    # an accelerometer that is off by so much along the vertical is likely off as much across it
    return Belief(belief.mean._replace(acc_bias=vector(foot.acc_bias)), belief.cov.with_entries(bias))


class _Filtered(NamedTuple):
    """One foot's states, their covariance, and what the filter says of itself."""

    mean: FootState
    cov: Covariance
    log_likelihood: Any
    nis: Any
    valid: Any


def _foot(p: FootParams, foot: FootSignals, options: FootOptions) -> _Filtered:
    zero = jnp.zeros_like(foot.rate)
    still = Vector(zero, zero, zero)
    level = options.level is True
    model = foot_model.MODEL if level else foot_model.ANYWHERE
    observed = FootObservation(still, zero) if level else FootVelocity(still)
    execution = options.execution
    if execution == "auto":
        execution = "fast" if foot.rate.shape[0] >= LONG and isinstance(options.method, filtering.EKF) else "dense"
    settings: dict[str, Any] = {
        "controls": controls(p, foot),
        "dt": foot.dt,
        "mask": foot.stands & foot.valid,
        "method": options.method,
        "initial": prior_of(p, foot),
        "execution": execution,
    }
    if options.smooth:
        told = ("log_likelihood", "nis", "count", "valid")
        if execution == "fast":
            settings["covariance"] = ("position", "velocity", "attitude")
        smoothed = filtering.kalman_smoother(model, model_params(p), observed, keep=told, **settings)
        mean, cov, posterior = smoothed.mean, smoothed.cov, smoothed.filtered
    else:
        posterior = filtering.kalman_filter(model, model_params(p), observed, **settings)
        mean, cov = posterior.mean, posterior.cov
    nis = jnp.sum(posterior.nis) / jnp.maximum(jnp.sum(posterior.count), 1.0)
    return _Filtered(mean, cov, jnp.sum(posterior.log_likelihood), nis, posterior.valid)


def run(p: FootParams, inputs: FootInputs, options: FootOptions = DEFAULT) -> Estimate:
    """Estimate from prepared inputs: pure, for jit, vmap and grad.

    Args:
        p: parameters.
        inputs: from `prepare`; stacked along a new first axis for `jax.vmap`.
        options: which parts are on; static under jit.

    Returns:
        `feet`, `strides` and their standard deviations; `distance` is the mean way of the feet worn, along their
        footholds; `diagnostics` holds log-likelihood, mean normalised innovation squared and pitch of each foot.
    """
    _check_options(options)
    found = []
    for side, foot in enumerate((inputs.right, inputs.left)):
        if foot is not None:
            path, told, valid = _one_foot(p, foot, inputs.time, options)
            found.append(_Found(side, path, told, valid, foot.count - 1))
    return _assembled(inputs.time, found)


def _check_options(options: FootOptions) -> None:
    if options.level not in (True, False, "auto"):
        raise ValueError(f"level must be True, False or 'auto'; got {options.level!r}")


def _one_foot(p: FootParams, foot: FootSignals, time: Any, options: FootOptions) -> tuple[Path, dict[str, Any], Any]:
    """One foot's way, what the filter says of itself, and where that holds."""
    found = _foot(p, foot, options)
    path = foot_strides.path_of(p, foot, time, found.mean, found.cov, flatten=options.level == "auto")
    return path, {"log_likelihood": found.log_likelihood, "nis": found.nis}, foot.valid & foot.known & found.valid


class _Found(NamedTuple):
    """One foot's part of the estimate; `rows` of its strides are real."""

    side: int
    path: Path
    told: dict[str, Any]
    valid: Any
    rows: Any


def _assembled(time: Any, found: list[_Found]) -> Estimate:
    """Both feet, or one, as an estimate."""
    feet: list[FootTrajectory | None] = [None, None]
    spread: list[FootTrajectory | None] = [None, None]
    strides, deviations, ways = [], [], []
    diagnostics: dict[str, Any] = {}
    for side, path, told, _, rows in found:
        feet[side], spread[side] = path.trajectory, path.stddev
        number = jnp.full(path.strides.length.shape, side, jnp.int32)
        strides.append(path.strides._replace(side=number))
        deviations.append(path.strides_stddev._replace(side=number))
        ways.append(foot_strides.walked(path.strides, rows, time))
        diagnostics |= {f"{name}_{SIDES[side]}": value for name, value in told.items()}
        diagnostics[f"pitch_{SIDES[side]}"] = path.pitch
    together = jax.tree.map(lambda *rows: jnp.concatenate(rows), *strides)
    certain = jax.tree.map(lambda *rows: jnp.concatenate(rows), *deviations)
    valid = found[0].valid if len(found) == 1 else found[0].valid | found[1].valid
    return Estimate(
        time, Legs(None, None), None, sum(ways[1:], ways[0]) / len(ways), valid, diagnostics, together, Feet(*feet),
        Feet(*spread), certain,
    )  # fmt: skip


_run_jit = jax.jit(run, static_argnames=("options",))
_one_foot_jit = jax.jit(_one_foot, static_argnames=("options",))


def prepared(recording: Recording, options: FootOptions = DEFAULT) -> Preparation:
    """The inputs of `run` for a recording; raises `RecordingError` as `foot_calibration.prepare`."""
    return prepare(recording, options.detector)


def estimator(options: FootOptions = DEFAULT) -> Estimator[FootParams, FootInputs]:
    """This estimator as a record of functions, for cohorts."""

    def ready(recording: Recording) -> Prepared[FootInputs]:
        preparation = prepared(recording, options)
        return Prepared(preparation.inputs, options, preparation.notes, preparation.standing)

    def estimated(p: FootParams, recording: Recording) -> Estimate:
        return estimate(p, recording, options)

    return Estimator("foot_ins", FootParams(), TRANSFORMS, ready, pad, run, with_body, ABOUT, estimated)


def estimate(p: FootParams, recording: Recording, options: FootOptions = DEFAULT) -> Estimate:
    """Trajectories and strides of the feet of one recording.

    Args:
        p: parameters.
        recording: sensors on one or both feet.
        options: which parts are on.

    Returns:
        An `Estimate`; `diagnostics["notes"]` says in words what was decided on the way, `footholds_right` and
        `footholds_left` are the samples at which each foot stands stillest.

    Raises:
        RecordingError: see `foot_calibration.prepare`.
        ValueError: a parameter outside its range.
    """
    params.check_params(p, TRANSFORMS)
    preparation = prepared(recording, options)
    samples = preparation.inputs.time.size
    # a detector has done its work by now: it need not be compiled for
    options = options._replace(detector=DEFAULT.detector)
    result = _in_windows(p, preparation.inputs, options)
    if result is None:
        padded = pad(preparation.inputs, bucket(samples, BUCKET))
        result = jax.tree.map(np.asarray, _run_jit(p, padded, options))
    trimmed = _trimmed(result, samples)
    feet = zip(SIDES, (preparation.inputs.right, preparation.inputs.left), strict=True)
    footholds = {f"footholds_{side}": foot.foothold[: int(foot.count)] for side, foot in feet if foot is not None}
    told = {"notes": preparation.notes, "standing": preparation.standing}
    diagnostics = {**trimmed.diagnostics, **footholds, **told}
    return trimmed._replace(diagnostics=diagnostics)


def _in_windows(p: FootParams, inputs: FootInputs, options: FootOptions) -> Estimate | None:
    """A long recording window by window, see `foot_windows`; None where one run will do, or windows will not."""
    _check_options(options)
    if inputs.time.size <= 1.5 * WINDOW or not options.smooth:
        return None
    found = []
    for side, foot in enumerate((inputs.right, inputs.left)):
        parts = None if foot is None else windows(foot, inputs.time.size)
        if foot is None:
            continue
        if parts is None:
            return None

        def one(window: FootSignals, time: Any) -> tuple[Path, Any, Any]:
            path, told, valid = _one_foot_jit(p, window, time, options)
            return path, told["nis"], valid

        whole = joined(foot, np.asarray(inputs.time), parts, level, one)
        rows = whole.path.strides.length.shape[0]
        found.append(_Found(side, whole.path, {"nis": whole.nis}, whole.valid, rows))
    return jax.tree.map(np.asarray, _assembled(jnp.asarray(inputs.time), found))


def _trimmed(result: Estimate, samples: int) -> Estimate:
    """Without padding: samples behind the recording, and rows that are no stride; strides in order of time."""
    padded = result.time.size

    def shorter(leaf: Any) -> Any:
        return leaf[:samples] if np.ndim(leaf) and leaf.shape[0] == padded else leaf

    own = {name: jax.tree.map(shorter, getattr(result, name))
           for name in ("time", "distance", "valid", "diagnostics", "feet", "feet_stddev")}  # fmt: skip
    rows = np.flatnonzero(result.strides.valid)
    rows = rows[np.argsort(result.strides.end[rows], kind="stable")]
    tables = {name: jax.tree.map(lambda column: column[rows], getattr(result, name))
              for name in ("strides", "strides_stddev")}  # fmt: skip
    return result._replace(**own, **tables)
