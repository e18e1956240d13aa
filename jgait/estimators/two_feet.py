r"""Both feet in one filter on their raw signals, tied by the range between them: trajectories and widths in one world.

Where `stride_width_ekf` takes trajectories as they are and asks how they lie to each other, here one error-state filter
has both feet, their biases, and how the one's world is turned from the other's. So a range corrects the strides
themselves, and what the filter says of its errors holds for widths too: nothing is stated about trajectories by hand.

Source: the future work of M. Potter, K. Liu, M. Selamet, G. Kumaravelu, "EKF estimation of stride width from individual
IMU-based foot trajectory estimates"; equations in `two_feet_model`.

Sensors:
    `foot_right` and `foot_left` as of `foot_ins`, and the distance from the inner side of the left ankle to the right
    leg, heard at least every few strides.

Outputs:
    Position, velocity and attitude of both feet in one world, the right foot's start at the origin and its first stride
    along x; strides as of `foot_ins`, with width and step length, and their standard deviations; z₁ and z₂.

How far to trust it:
    As `stride_width_ekf`: a width whose standard deviation is above `TwoFeetOptions.widest_stddev` is flagged in
    `diagnostics["width_valid"]`. Standard deviations of positions are since the last foothold; how far the feet are
    apart, `z1_stddev` and `z2_stddev` say.

Parameters without a gradient: none of the estimate; `offset_noise`, `passing_offset_noise` and `foot.stride_noise` show
in standard deviations only. What decides (stances, ranges used, turns) has none.

Cost: 33 error components take the dense path, 2 ms a sample on one core with the smoother, and a minute to compile.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jgait import filtering, params
from jgait.estimators import foot_ins, two_feet_model, two_feet_readout
from jgait.estimators.foot_ins.inputs import FootSignals
from jgait.estimators.foot_ins.model import FootObservation
from jgait.estimators.interface import Estimator, Prepared, bucket
from jgait.estimators.two_feet_calibration import prepare
from jgait.estimators.two_feet_inputs import TwoFeetInputs, pad
from jgait.estimators.two_feet_model import Plane, TwoFeetControl, TwoFeetModelParams, TwoFeetObservation, TwoFeetState
from jgait.estimators.two_feet_params import DEFAULT, TRANSFORMS, TwoFeetOptions, TwoFeetParams, with_body
from jgait.filtering import Belief, Covariance
from jgait.geometry.vectors import Vector
from jgait.types import SIDES, Estimate, Legs, Recording

__all__ = [
    "DEFAULT",
    "TRANSFORMS",
    "TwoFeetInputs",
    "TwoFeetOptions",
    "TwoFeetParams",
    "estimate",
    "estimator",
    "pad",
    "prepare",
    "run",
    "with_body",
]


def model_params(p: TwoFeetParams) -> TwoFeetModelParams:
    """The model's parameters: variances."""
    return TwoFeetModelParams(foot_ins.model_params(p.foot), p.passing_offset, p.range_noise**2, p.passing_noise**2)


def prior_of(p: TwoFeetParams, inputs: TwoFeetInputs) -> Belief:
    """The belief at the start: both feet as `foot_ins` has them, side by side."""
    right, left = (foot_ins.prior_of(p.foot, foot) for foot in (inputs.right, inputs.left))
    stddev = (p.start_across, p.start_along, p.start_heading)
    return two_feet_model.joined_belief(right, left, inputs.heading_right[0], inputs.yaw, p.start_width, stddev)


def _belief(
    p: TwoFeetParams, inputs: TwoFeetInputs, options: TwoFeetOptions
) -> tuple[TwoFeetState, Covariance, filtering.Posterior]:
    """States, their covariance, and what the filter says of itself."""
    zero = jnp.zeros_like(inputs.right.rate)
    ahead = Plane(jnp.cos(inputs.heading_right), jnp.sin(inputs.heading_right))
    observed = FootObservation(Vector(zero, zero, zero), zero)
    seen = inputs.seen & inputs.right.valid & inputs.left.valid
    settings: dict[str, Any] = {
        "controls": TwoFeetControl(
            foot_ins.controls(p.foot, inputs.right), foot_ins.controls(p.foot, inputs.left), inputs.distance,
            inputs.late, ahead, inputs.right.dt, inputs.left.dt,
        ),
        "mask": TwoFeetObservation(_seen(inputs.right, options), _seen(inputs.left, options), seen, seen),
        "method": options.method,
        "initial": prior_of(p, inputs),
        "execution": options.execution,
    }  # fmt: skip
    told = TwoFeetObservation(observed, observed, inputs.distance + p.range_offset, zero + p.passing_offset)
    model, mp = two_feet_model.MODEL, model_params(p)
    if not options.smooth:
        found = filtering.kalman_filter(model, mp, told, **settings)
        return found.mean, found.cov, found
    smoothed = filtering.kalman_smoother(model, mp, told, keep=("log_likelihood", "nis", "count", "valid"), **settings)
    return smoothed.mean, smoothed.cov, smoothed.filtered


def _seen(foot: FootSignals, options: TwoFeetOptions) -> FootObservation:
    """What is told of one foot: that it stands."""
    stands = foot.stands & foot.valid
    level = stands if options.level is True else jnp.zeros_like(stands)
    return FootObservation(Vector(stands, stands, stands), level)


def run(p: TwoFeetParams, inputs: TwoFeetInputs, options: TwoFeetOptions = DEFAULT) -> Estimate:
    """Estimate from prepared inputs: pure, for jit, vmap and grad.

    Args:
        p: parameters.
        inputs: from `prepare`; stacked along a new first axis for `jax.vmap`.
        options: which parts are on; static under jit.

    Returns:
        `feet`, `strides` (rows of the right foot, then of the left) and their standard deviations. `diagnostics`: `z1`,
        `z2`, `z1_stddev`, `z2_stddev` (T,) [m], at `double_support` (T,) the base of support; `turning` (T,);
        `width_valid`, by stride; `ranges` used; `yaw`, by which the left foot's own world is turned, and its standard
        deviation [rad]; log-likelihood, mean normalised innovation squared, and pitch of each foot.

    Raises:
        ValueError: for an unknown `level`.
    """
    if options.level not in (True, False, "auto"):
        raise ValueError(f"level must be True, False or 'auto'; got {options.level!r}")
    state, cov, posterior = _belief(p, inputs, options)
    found = two_feet_readout.read(p, inputs, state, cov, flatten=options.level == "auto")
    width = found.strides_stddev.width
    diagnostics = {
        **found.distances,
        "double_support": inputs.double_support,
        "turning": inputs.turning,
        "width_valid": jnp.isfinite(found.strides.width) & (width <= options.widest_stddev),
        "ranges": jnp.sum(inputs.seen & inputs.right.valid & inputs.left.valid),
        "yaw": state.yaw[-1],
        "yaw_stddev": cov.stddev().yaw[-1],
        "log_likelihood": jnp.sum(posterior.log_likelihood),
        "nis": jnp.sum(posterior.nis) / jnp.maximum(jnp.sum(posterior.count), 1.0),
        **{f"pitch_{side}": pitch for side, pitch in zip(SIDES, found.pitch, strict=True)},
    }
    valid = inputs.right.valid & inputs.left.valid & posterior.valid
    return Estimate(
        inputs.time, Legs(None, None), None, None, valid, diagnostics, found.strides, found.feet, found.stddev,
        found.strides_stddev,
    )  # fmt: skip


_run_jit = jax.jit(run, static_argnames=("options",))


def estimator(options: TwoFeetOptions = DEFAULT) -> Estimator[TwoFeetParams, TwoFeetInputs]:
    """This estimator as a record of functions, for cohorts."""

    def ready(recording: Recording) -> Prepared[TwoFeetInputs]:
        return prepare(recording, options)

    return Estimator("two_feet", TwoFeetParams(), TRANSFORMS, ready, pad, run, with_body)


def estimate(
    p: TwoFeetParams, recording: Recording, options: TwoFeetOptions = DEFAULT, *,
    start_heading: tuple[float, float] | None = None,
) -> Estimate:  # fmt: skip
    """Trajectories, strides and widths of one recording.

    Args:
        p: parameters; at least the range's offset should be the person's own.
        recording: sensors on both feet, and the range between them.
        options: which parts are on.
        start_heading: see `prepare`.

    Returns:
        As `run`, strides in order of their ends; `diagnostics["notes"]` says in words what was decided on the way.

    Raises:
        RecordingError: see `prepare`.
        ValueError: a parameter outside its range.
    """
    params.check_params(p, TRANSFORMS)
    ready = prepare(recording, options, start_heading=start_heading)
    samples = ready.inputs.time.size
    padded = pad(ready.inputs, bucket(samples, foot_ins.BUCKET))
    result = jax.tree.map(np.asarray, _run_jit(p, padded, options))
    rows = np.flatnonzero(result.strides.valid)
    rows = rows[np.argsort(result.strides.end[rows], kind="stable")]
    by_stride = {"width_valid": result.diagnostics.pop("width_valid")[rows]}
    strides, deviations = (jax.tree.map(lambda v: v[rows], of) for of in (result.strides, result.strides_stddev))
    result = jax.tree.map(
        lambda v: v[:samples] if np.ndim(v) else v, result._replace(strides=None, strides_stddev=None)
    )
    diagnostics = {**result.diagnostics, **by_stride, "notes": ready.notes, "standing": ready.standing}
    return result._replace(diagnostics=diagnostics, strides=strides, strides_stddev=deviations)
