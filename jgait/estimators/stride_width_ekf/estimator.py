"""From the feet's paths and the range between them to stride widths."""

import jax.numpy as jnp

from jgait import filtering
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins.params import FootOptions, FootParams
from jgait.estimators.interface import Estimator, Prepared, with_measures
from jgait.estimators.programs import compiled
from jgait.estimators.stride_width_ekf import model as width_model
from jgait.estimators.stride_width_ekf import readout as width_readout
from jgait.estimators.stride_width_ekf.about import ABOUT
from jgait.estimators.stride_width_ekf.from_sensors import feet_of, measured_only, merged
from jgait.estimators.stride_width_ekf.inputs import WidthInputs
from jgait.estimators.stride_width_ekf.model import WidthControl, WidthModelParams, WidthObservation
from jgait.estimators.stride_width_ekf.notes import RANGES_MISFIT
from jgait.estimators.stride_width_ekf.params import DEFAULT, WidthOptions, WidthParams
from jgait.estimators.stride_width_ekf.prepare import prepare_from_feet
from jgait.filtering import Model
from jgait.geometry.arrays import xp
from jgait.geometry.vectors import root
from jgait.types import Estimate, Feet, FootTrajectory, Legs, Measures, Recording

MOST_MISFITS = 0.3
"""[1] Share of misfits above which no width is valid; 5 % are expected. Chosen: simulated walks of ten gaits, and a
recorded one with distances between markers, have fewer; ranges of which half are far too short, and ranges that are
read at any moment, have more. The innovation of a misfit is above two standard deviations, across or along."""


def model_params(p: WidthParams) -> WidthModelParams:
    """The model's parameters: variances."""
    names = ("position", "heading", "turn", "range", "passing")
    return WidthModelParams(*(getattr(p, f"{name}_noise") ** 2 for name in names))


def _states(p: WidthParams, inputs: WidthInputs, options: WidthOptions, model: Model) -> filtering.Inferred:
    usual = p.usual_passing + p.passing_share * inputs.distance
    across = jnp.where(inputs.usual, usual, inputs.distance + p.range_offset)
    params = model_params(p)
    params = params._replace(range_noise=jnp.where(inputs.usual, p.usual_noise**2, params.range_noise))
    right, left = inputs.start_heading[0], inputs.start_heading[1]
    prior = width_model.start_belief(right, left, p.start_width, p.start_across, p.start_along, p.start_heading)
    return filtering.infer(
        model, params, WidthObservation(across, jnp.zeros_like(across) + p.passing_offset),
        smooth=options.smooth, dt=1.0, controls=WidthControl(inputs.right, inputs.left),
        mask=inputs.range_measured & inputs.valid, method=options.method, initial=prior,
        keep=(*filtering.SUMMARY, "innovation", "innovation_stddev"),
    )  # fmt: skip


def run(
    p: WidthParams, inputs: WidthInputs, options: WidthOptions = DEFAULT, model: Model = width_model.MODEL
) -> Estimate:
    """Estimate from prepared inputs: pure, for jit, vmap and grad, with static options; `model` replaces that of the
    feet.

    Returns:
        Estimate at N moments, with `strides`, `strides_stddev` (fields (N,), padded) and `feet` (positions in one world
        frame, heights of `inputs`; no velocity, no attitude). `diagnostics`: `z1`, `z2`, `z1_stddev`, `z2_stddev` (N,)
        [m], at `double_support` (N,) the base of support; `width_valid` (N,), by stride; number of `ranges` used,
        and of `misfits` among them; `log_likelihood` of the innovations and their mean normalised square
        `nis`.
    """
    inferred = compiled(_states)(p, inputs, options=options, model=model)
    mean, cov = inferred.mean, inferred.cov
    used = xp.sum(inputs.range_measured & inputs.valid & ~inputs.usual)
    # where masked, innovations are 0 and their deviations 1
    pairs = zip(inferred.filtered.innovation, inferred.filtered.innovation_stddev, strict=True)
    misfits = xp.max(xp.stack([xp.sum(xp.abs(innovation) > 2.0 * stddev) for innovation, stddev in pairs]))
    offset_noise = xp.where(inputs.usual, p.people_noise, p.offset_noise).astype(mean.x_right.dtype)
    p = p._replace(offset_noise=offset_noise)
    values, spread = width_readout.strides(p, inputs.strides, mean, cov)
    dtype = values.width.dtype
    fits = misfits.astype(dtype) <= xp.maximum(MOST_MISFITS * used.astype(dtype), 1.0)
    fits |= inputs.usual
    diagnostics = {
        **width_readout.distances(p, mean, cov),
        "double_support": inputs.double_support,
        "turning": inputs.turning,
        "width_valid": fits & xp.isfinite(values.width) & (spread.width <= options.widest_stddev),
        "ranges": used,
        "misfits": misfits,
        "log_likelihood": inferred.log_likelihood,
        "nis": inferred.nis,
    }
    right, level = (mean.x_right, mean.y_right), xp.zeros_like(inputs.height_right)
    left = (mean.x_right + mean.apart_x, mean.y_right + mean.apart_y)
    spread_right = [root(cov[f"{axis}_right", f"{axis}_right"]) for axis in "xy"]
    spread_left = [
        root(cov[a, a] + 2.0 * cov[a, b] + cov[b, b]) for a, b in (("x_right", "apart_x"), ("y_right", "apart_y"))
    ]
    placed = (*right, inputs.height_right), (*left, inputs.height_left), (*spread_right, level), (*spread_left, level)
    tracks = [FootTrajectory(xp.stack(parts, axis=1), None, None) for parts in placed]
    valid = inputs.valid & inferred.filtered.valid
    return Estimate(
        inputs.time, Legs(None, None), None, None, valid, diagnostics, values, Feet(*tracks[:2]), Feet(*tracks[2:]),
        spread,
    )  # fmt: skip


def with_body(p: WidthParams, body: Measures) -> WidthParams:
    """The parameters with a person's "range_offset" and "passing_offset" [m], if known; ValueError for other names."""
    return with_measures("the stride width estimator", ("range_offset", "passing_offset"), p, body)


def estimator(
    options: WidthOptions = DEFAULT, foot_params: FootParams = FootParams(),
    foot_options: FootOptions = foot_ins.DEFAULT, start_heading: tuple[float, float] = (0.0, 0.0),
) -> Estimator[WidthParams, WidthInputs]:  # fmt: skip
    """This estimator as a record of functions; `prepare` estimates the feet's trajectories. Arguments as `estimate`."""

    def ready(recording: Recording) -> Prepared[WidthInputs]:
        feet, stances = feet_of(recording._replace(notes=()), foot_params, foot_options)
        assert feet.feet is not None
        prepared = prepare_from_feet(
            feet.time, measured_only(feet, recording, stances), stances, recording.feet_range, options,
            start_heading=start_heading,
        )  # fmt: skip
        notes = (*feet.diagnostics["notes"], *prepared.notes)
        standing, quality = feet.diagnostics["standing"], feet.diagnostics["sensors"]
        return prepared._replace(notes=notes, standing=standing, extra=(feet, stances), quality=quality)

    return Estimator("stride_width_ekf", WidthParams(), ready, run, with_body, ABOUT, ("width_valid",), _finished,
                     through=True)  # fmt: skip


def estimate(
    p: WidthParams, recording: Recording, options: WidthOptions = DEFAULT, *, foot_params: FootParams = FootParams(),
    foot_options: FootOptions = foot_ins.DEFAULT, start_heading: tuple[float, float] = (0.0, 0.0),
) -> Estimate:  # fmt: skip
    """Trajectories of both feet in one world frame, with stride widths, from the sensors of one recording.

    Args:
        p: parameters; at least the range's offset should be measured on the person.
        recording: sensors on both feet, and `feet_range`; without a range, widths have the mean of usual people.
        options: options of the width estimate.
        foot_params: parameters of the trajectories, see `foot_ins`.
        foot_options: options of the trajectories.
        start_heading: see `prepare_from_feet`.

    Returns:
        As `foot_ins.estimate`, trajectories in one world and strides with width and step length; of the diagnostics
        of `run`, `width_valid` has one entry for each stride; `z1` and the others are at `moment_time`.

    Raises:
        RecordingError: see `foot_ins.estimate` and `prepare_from_feet`.
        ValueError: a parameter outside its range.
    """
    return estimator(options, foot_params, foot_options, start_heading).estimate(p, recording)


def _finished(result: Estimate, made: Prepared[WidthInputs]) -> Estimate:
    """The estimate with a note if ranges do not fit; merged into that of `foot_ins` if made from sensors."""
    ranges, misfits = int(result.diagnostics["ranges"]), int(result.diagnostics["misfits"])
    if ranges and misfits > max(MOST_MISFITS * ranges, 1):
        note = RANGES_MISFIT(misfits=misfits, ranges=ranges)
        result.diagnostics["notes"] = (*result.diagnostics["notes"], note)
    if made.extra is None:
        return result
    feet, stances = made.extra
    return merged(feet, stances, result)
