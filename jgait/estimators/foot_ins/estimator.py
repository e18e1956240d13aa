"""Foot trajectories and strides from prepared inputs."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait import filtering, quality
from jgait.estimators import noise
from jgait.estimators.foot_ins import model as foot_model
from jgait.estimators.foot_ins import readout as foot_strides
from jgait.estimators.foot_ins import windows as foot_windows
from jgait.estimators.foot_ins.about import ABOUT
from jgait.estimators.foot_ins.model import FootControl, FootError, FootModelParams, FootObservation
from jgait.estimators.foot_ins.params import DEFAULT, FootOptions, FootParams, with_body
from jgait.estimators.foot_ins.prepare import FootInputs, FootSignals, prepare
from jgait.estimators.foot_ins.readout import Path
from jgait.estimators.interface import Estimator, Prepared
from jgait.estimators.notes import NO_STEPS
from jgait.estimators.programs import compiled
from jgait.estimators.walking import cut_notes, cut_off, of_turns
from jgait.filtering import Belief
from jgait.geometry.arrays import for_each, stacked, xp
from jgait.quality import SensorQuality, merged
from jgait.quality.evidence import of_estimate
from jgait.types import SIDES, Estimate, Feet, Flags, FootTrajectory, Legs, Recording, Values, as_float

PER_STRIDE = ("stride_nis",)
"""Diagnostics with an entry for each stride."""

CONSTANT_VELOCITY_S = 0.1
"""[s] Time over which the velocity of a standing foot is nearly constant, see `likelihood`."""


def model_params(p: FootParams) -> FootModelParams:
    """The model's parameters."""
    return FootModelParams(p.pivot_height, p.gyr_bias_walk**2, p.acc_bias_walk**2, p.height_noise**2)


def velocity_variance(p: FootParams, foot: FootSignals, soft: bool) -> Values:
    """Variance of the zero velocity (T,) [m²/s²]: R = (σ² + (c |ω|)²) exp(noise model) / w.

    The weight w is 1, or if `soft`, w = sigmoid((margin + log threshold_factor) / softness): 1 in a stance that is
    clear, 0 in a swing. The exponent is limited so that single precision holds.
    """
    base = p.velocity_noise**2 + (p.rate_noise * foot.rate) ** 2
    exponent = p.noise.log_scale(foot.features)
    if soft:
        exponent = exponent + jax.nn.softplus(-(foot.margin + jnp.log(p.threshold_factor)) / p.softness)
    return base * jnp.exp(jnp.clip(exponent, -12.0, 25.0))


def controls(p: FootParams, foot: FootSignals, options: FootOptions = DEFAULT) -> FootControl:
    """Signals and noise densities for the filter: an error that is constant over an interval h has the density σ² h."""
    h = foot.dt
    return FootControl(
        gyr=foot.gyr,
        acc=foot.acc,
        gyr_density=p.gyr_noise**2 + ((p.gyr_jump_noise * foot.gyr_jump) ** 2 + foot.gyr_doubt**2) * h,
        acc_density=p.acc_noise**2 + ((p.acc_jump_noise * foot.acc_jump) ** 2 + foot.acc_doubt**2) * h,
        velocity_variance=velocity_variance(p, foot, options.soft),
        restart=foot.restart,
    )


def prior_of(p: FootParams, foot: FootSignals) -> Belief:
    """The belief at the first stance: sensor at rest, tilt from gravity, gyroscope bias as measured at rest.

    Gravity corrects the gyroscope bias about horizontal axes, but not about the vertical axis. So the bias about the
    vertical gets the smaller variance, which includes a slow rotation of the foot during rest (`sway`).
    """
    dtype = foot.gyr.dtype
    tilt = jnp.asarray(p.tilt, dtype) ** 2
    vertical = p.gyr_bias**2 + (p.sway / foot.still_time) ** 2
    level = jnp.maximum(vertical, p.gyr_bias_tilt**2)
    bias = level * jnp.eye(3, dtype=dtype) + (vertical - level) * jnp.outer(foot.up, foot.up)
    zero = jnp.zeros(3, dtype)
    variances = FootError(
        position=zero + foot_model.AGAIN,
        velocity=zero + 1e-4,
        attitude=jnp.stack([tilt, tilt, jnp.asarray(1e-8, dtype)]),
        gyr_bias=zero,
        # the horizontal accelerometer bias is assumed to be as large as the measured vertical bias
        acc_bias=zero + p.acc_bias**2 + jnp.sum(foot.acc_bias**2),
    )
    belief = foot_model.standing_belief(foot.attitude, foot.gyr_bias, variances)
    cov = belief.cov.with_entries({("gyr_bias", "gyr_bias"): bias})
    return Belief(belief.mean._replace(acc_bias=foot.acc_bias), cov)


def filtered(
    p: FootParams, foot: FootSignals, once: Flags | bool = True, initial: Belief | None = None, *,
    options: FootOptions, keep: tuple[str, ...] = filtering.SUMMARY,
) -> filtering.Inferred:  # fmt: skip
    """The states of one foot; zero velocity is observed in samples that are `once`. The same offline and online.

    `initial` is the belief before the first sample; None: `prior_of`, the belief at the first stance.
    """
    zero = jnp.zeros_like(foot.gyr)
    stands = (foot.valid if options.soft else foot.stands & foot.valid) & once
    return filtering.infer(
        foot_model.MODEL, model_params(p), FootObservation(zero, zero[:, 0]), smooth=options.smooth,
        controls=controls(p, foot, options), dt=foot.dt,
        mask=FootObservation(stands, stands if options.level is True else False),
        method=options.method, initial=prior_of(p, foot) if initial is None else initial, keep=keep,
        covariance=("position", "velocity", "attitude"),
    )  # fmt: skip


def run(p: FootParams, inputs: FootInputs, options: FootOptions = DEFAULT) -> Estimate:
    """Estimate from prepared inputs: pure, for jit, vmap and grad, with static options.

    Returns:
        `feet`, `strides` and their standard deviations; `distance` is the distance along the footholds, mean
        of the feet; `diagnostics` holds log-likelihood, mean normalised innovation squared and pitch of each foot.
    """
    feet = _worn(inputs)
    every = _paths(p, stacked(*feet.values()), inputs.time, options)
    return _assembled(
        inputs.time, {side: jax.tree.map(lambda leaf, k=number: leaf[k], every) for number, side in enumerate(feet)}
    )


def likelihood(p: FootParams, inputs: FootInputs, options: FootOptions = DEFAULT) -> Values:
    """Log-likelihood of the velocity of standing feet, summed over the feet [nat], for tuning without a reference.

    The velocity of a standing foot is nearly constant over `CONSTANT_VELOCITY_S`. So one sample in
    `CONSTANT_VELOCITY_S` counts, with the variance of the mean of all; if every sample counted, the most likely foot
    would not move in stance. The density is Student's t with 4 degrees of freedom and the filter's covariance as its
    scale, so that a few hard landings do not determine the noise.

    Source: K. L. Lange, R. J. A. Little and J. M. G. Taylor, "Robust statistical modeling using the t distribution",
    Journal of the American Statistical Association 84(408), 1989.
    """
    number = jnp.floor(jnp.asarray(inputs.time) / CONSTANT_VELOCITY_S)
    first = number != jnp.concatenate([number[:1] - 1.0, number[:-1]])

    def foot_likelihood(foot: FootSignals) -> Values:
        near = CONSTANT_VELOCITY_S * jnp.sum(jnp.sign(foot.dt)) / jnp.maximum(jnp.sum(foot.dt), CONSTANT_VELOCITY_S)
        less = jnp.sqrt(jnp.maximum(near, 1.0))
        q = p._replace(velocity_noise=p.velocity_noise / less, rate_noise=p.rate_noise / less)
        return jnp.sum(filtered(q, foot, first, options=options._replace(smooth=False)).filtered.student_t(4.0))

    return jnp.sum(jax.vmap(foot_likelihood)(stacked(*_worn(inputs).values())))


def _worn(inputs: FootInputs) -> dict[int, FootSignals]:
    """Side (0 right, 1 left) → signals of each foot with a sensor."""
    return {side: foot for side, foot in enumerate((inputs.right, inputs.left)) if foot is not None}


class _FootResult(NamedTuple):
    """One foot's path, diagnostics of its filter, distance (T,) [m], and (T,) bool of valid samples."""

    path: Path
    diagnostics: dict[str, Any]
    way: Values
    valid: Flags


def _paths(p: FootParams, feet: FootSignals, time: Values, options: FootOptions) -> _FootResult:
    """The paths of some feet along a first axis."""

    def path_of(foot: FootSignals, states: filtering.Inferred) -> _FootResult:
        path = foot_strides.path_of(p, foot, time, states, flatten=options.level == "auto")
        way = foot_strides.walked(path.strides, foot.count - 1, time)
        diagnostics = {"log_likelihood": states.log_likelihood, "nis": states.nis}
        return _FootResult(path, diagnostics, way, foot.valid & foot.known & states.filtered.valid)

    return for_each(path_of, feet, compiled(filtered, over=(None, 0))(p, feet, options=options))


def _assembled(time: Values, results: dict[int, _FootResult]) -> Estimate:
    """The estimate of one or two feet, and of the strides of all of them."""
    feet: list[FootTrajectory | None] = [None, None]
    spread: list[FootTrajectory | None] = [None, None]
    diagnostics: dict[str, Any] = {}
    tables = []
    for side, (path, foot_diagnostics, _, _) in results.items():
        feet[side], spread[side] = path.trajectory, path.stddev
        diagnostics |= {f"{name}_{SIDES[side]}": value for name, value in foot_diagnostics.items()}
        diagnostics[f"pitch_{SIDES[side]}"] = path.pitch
        sides = np.full(path.nis.shape, side, np.int32)
        tables.append((path.strides._replace(side=sides), path.strides_stddev._replace(side=sides), path.nis))
    strides, deviations, diagnostics["stride_nis"] = jax.tree.map(lambda *rows: xp.concatenate(rows), *tables)
    ways, valid = (xp.stack([getattr(foot, name) for foot in results.values()]) for name in ("way", "valid"))
    return Estimate(
        time, Legs(None, None), None, xp.mean(ways, axis=0), xp.any(valid, axis=0), diagnostics, strides, Feet(*feet),
        Feet(*spread), deviations,
    )  # fmt: skip


def estimator(options: FootOptions = DEFAULT) -> Estimator[FootParams, FootInputs]:
    """This estimator as a record of functions. Raises ValueError for an unknown level or noise model."""
    if options.level not in (True, False, "auto"):
        raise ValueError(f"level must be True, False or 'auto'; got {options.level!r}")
    start = FootParams(noise=noise.model_of(options.noise))
    used = {"height_noise": options.level is True, "softness": options.soft, "threshold_factor": options.soft}
    return Estimator(
        "foot_ins", start, partial(prepare, options=options), run, with_body, ABOUT, PER_STRIDE, _finished, _in_windows,
        unused=tuple(name for name, of_use in used.items() if not of_use), likelihood=likelihood, through=True,
    )  # fmt: skip


def estimate(p: FootParams, recording: Recording, options: FootOptions = DEFAULT) -> Estimate:
    """Trajectories and strides of the feet of one recording, with sensors on one or both feet.

    Returns:
        An `Estimate`; `diagnostics["notes"]` lists decisions made in `prepare`, `footholds_right` and `footholds_left`
        are the samples at which each foot moves least in each stance.

    Raises:
        RecordingError: see `prepare`.
        ValueError: a parameter outside its range.
    """
    return estimator(options).estimate(p, recording)


def _finished(result: Estimate, made: Prepared[FootInputs]) -> Estimate:
    """The estimate with footholds, without a drift between the headings of two feet, and with doubts.

    `distance_stddev` (T,) [m]: errors of strides have one cause, so that they add up.
    """
    feet = _worn(made.inputs)
    worn = {side: f"foot_{SIDES[side]}" for side in feet}
    footholds = {f"footholds_{SIDES[side]}": foot.foothold[: int(foot.count)] for side, foot in feet.items()}
    result = result._replace(diagnostics={**result.diagnostics, **footholds})
    result = foot_strides.with_headings_together(result) if made.options.smooth and len(feet) == 2 else result
    cut = cut_off(result, {side: (worn[side], foot.gyr - foot.gyr_bias) for side, foot in feet.items()})
    valid = np.asarray(result.strides.valid, bool)
    walks = set(np.asarray(result.strides.side)[valid].tolist())
    none = {name: SensorQuality(unusable=True) for side, name in worn.items() if side not in walks}
    diagnostics = {
        **result.diagnostics, "sensors": merged(result.diagnostics["sensors"], cut, none),
        "notes": (*result.diagnostics["notes"], *cut_notes(cut), *(NO_STEPS(placement=name) for name in none)),
    }  # fmt: skip
    result = result._replace(diagnostics=diagnostics)
    if made.options.soft:  # its noise is tuned, and limits for it are not known
        return result
    length, spread, turn = (as_float(part)[valid] for part in
                            (result.strides.length, result.strides_stddev.length, result.strides.turn))  # fmt: skip
    way, turned = as_float(result.distance), as_float(of_turns(length, turn)[1]).sum() / len(feet)
    share = np.hypot(spread.sum() / max(length.sum(), 1e-9), turned / max(float(way[-1]), 1e-9))
    diagnostics["distance_stddev"] = share * way
    return quality.judged(result, "foot_ins", of_estimate(result, worn), worn)


def _in_windows(p: FootParams, inputs: FootInputs, options: FootOptions) -> Estimate | None:
    """A long recording in windows, see `foot_ins.windows`; None if it is short or cannot be cut into windows."""
    if inputs.time.size <= 1.5 * foot_windows.WINDOW or not options.smooth:
        return None

    def path_of_window(window: FootSignals, time: Values) -> PyTree:
        paths = jax.tree.map(lambda leaf: leaf[0], _paths(p, stacked(window), time, options))
        return paths.path, paths.diagnostics["nis"], paths.valid

    results = {}
    for side, foot in _worn(inputs).items():
        cuts = foot_windows.windows(foot, inputs.time.size)
        if cuts is None:
            return None
        path, nis, valid = foot_windows.joined(foot, np.asarray(inputs.time), cuts, path_of_window)
        way = foot_strides.walked(path.strides, path.strides.length.shape[0], jnp.asarray(inputs.time))
        results[side] = _FootResult(path, {"nis": nis}, way, valid)
    return _assembled(jnp.asarray(inputs.time), results)
