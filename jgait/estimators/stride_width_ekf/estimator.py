"""From the feet's paths and the range between them to stride widths."""

import jax.numpy as jnp
import numpy as np

from jgait import filtering
from jgait.estimators import foot_ins
from jgait.estimators.checks import not_bridged, sensors_of
from jgait.estimators.foot_ins.params import FootOptions, FootParams
from jgait.estimators.interface import Estimator, Prepared, with_measures
from jgait.estimators.notes import LONGEST_LOSS
from jgait.estimators.programs import compiled
from jgait.estimators.stride_width_ekf import model as width_model
from jgait.estimators.stride_width_ekf import readout as width_readout
from jgait.estimators.stride_width_ekf.about import ABOUT
from jgait.estimators.stride_width_ekf.model import WidthControl, WidthObservation
from jgait.estimators.stride_width_ekf.params import DEFAULT, WidthOptions, WidthParams
from jgait.estimators.stride_width_ekf.prepare import WidthInputs, prepare_from_feet
from jgait.estimators.stride_width_ekf.trajectories import SHORTEST_WAY
from jgait.filtering import Model
from jgait.geometry.arrays import xp
from jgait.geometry.rotation import turned, yawed
from jgait.geometry.vectors import root
from jgait.notes import Kind
from jgait.signal.windows import true_runs
from jgait.types import (
    SIDES,
    Estimate,
    Feet,
    Flags,
    FootTrajectory,
    Legs,
    Measures,
    Recording,
    RecordingError,
    Strides,
    as_float,
)  # fmt: skip

RANGES_MISFIT = Kind(
    "ranges_misfit", "check", "{misfits} of {ranges} ranges do not fit the paths of the feet: no width is valid",
    "The range sensor may be broken, its unit or its times may be wrong, or echoes of other things than the leg are "
    "among its distances. Stride widths and step lengths are not valid, and count in no mean or median.",
)  # fmt: skip


def _states(p: WidthParams, inputs: WidthInputs, options: WidthOptions, model: Model) -> filtering.Inferred:
    usual = p.usual_passing + p.passing_share * inputs.distance
    across = jnp.where(inputs.usual, usual, inputs.distance + p.range_offset)
    prior = width_model.start_belief(p, inputs.start_heading[0], inputs.start_heading[1])
    p = p._replace(range_noise=jnp.where(inputs.usual, p.usual_noise, p.range_noise))
    return filtering.infer(
        model, p, WidthObservation(across, jnp.zeros_like(across) + p.passing_offset),
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
    fits = misfits.astype(dtype) <= xp.maximum(options.most_misfits * used.astype(dtype), 1.0)
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
        if missing := [repr(name) for side in SIDES if (name := f"foot_{side}") not in recording.sensors]:
            raise RecordingError(f"stride_width_ekf needs {' and '.join(missing)}; {sensors_of(recording)}")
        feet = foot_ins.estimate(foot_params, recording._replace(notes=()), foot_options)
        right, left = (feet.diagnostics[f"footholds_{side}"] for side in SIDES)
        stances = right, left
        assert feet.feet is not None
        prepared = prepare_from_feet(
            feet.time, _measured_only(feet, recording, stances), stances, recording.feet_range, options,
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
    if ranges and misfits > max(made.options.most_misfits * ranges, 1):
        note = RANGES_MISFIT(misfits=misfits, ranges=ranges)
        result.diagnostics["notes"] = (*result.diagnostics["notes"], note)
    if made.extra is None:
        return result
    feet, stances = made.extra
    return _merged(feet, stances, result)


def _measured_only(estimate: Estimate, recording: Recording, stances: tuple[np.ndarray, np.ndarray]) -> Feet:
    """The feet with NaN from the foothold before a long loss of samples to the one after it: how a foot moves between
    them is not known.
    """
    assert estimate.feet is not None
    time, feet = np.asarray(estimate.time, np.float64), []
    for side, foot, mids in zip(SIDES, estimate.feet, stances, strict=True):
        lost = not_bridged(~np.asarray(recording.sensors[f"foot_{side}"].mask, bool), time, LONGEST_LOSS)
        unknown = np.zeros(time.size, bool)
        for first, after in true_runs(lost):
            unknown[max(mids[mids < first], default=-1) + 1 : min(mids[mids >= after], default=time.size)] = True
        assert foot is not None
        feet.append(foot._replace(position=np.where(unknown[:, None], np.nan, foot.position)))
    return Feet(*feet)


def _merged(alone: Estimate, stances: tuple[np.ndarray, np.ndarray], together: Estimate) -> Estimate:
    """The `foot_ins` estimate `alone` with stride widths, and both feet in one world: each stride is moved from its
    footholds at the samples `stances` to those of `together`.
    """
    feet = Feet(*(_placed(alone, side, mids, together) for side, mids in zip(SIDES, stances, strict=True)))
    matches = _matches(alone.strides, together.strides)

    def with_widths(table: Strides, other: Strides) -> Strides:
        # a stride without a row of the filter takes what is behind the last one
        width, step = (np.append(as_float(column), np.nan)[matches] for column in (other.width, other.step_length))
        return table._replace(width=width, step_length=step)

    trusted = np.append(np.asarray(together.diagnostics["width_valid"], bool), False)[matches]
    trusted &= ~_at_doubtful_footholds(alone.strides, alone.diagnostics["doubtful"])
    diagnostics = {
        **alone.diagnostics, **together.diagnostics, "moment_time": np.asarray(together.time), "width_valid": trusted,
    }  # fmt: skip
    return alone._replace(
        feet=feet, strides=with_widths(alone.strides, together.strides),
        strides_stddev=with_widths(alone.strides_stddev, together.strides_stddev), diagnostics=diagnostics,
    )  # fmt: skip


def _placed(alone: Estimate, side: str, mids: np.ndarray, together: Estimate) -> FootTrajectory:
    """One foot's trajectory; each stride is rotated and scaled to start and end at the footholds of `together`."""
    assert alone.feet is not None
    assert together.feet is not None
    trajectory, common = getattr(alone.feet, side), getattr(together.feet, side).position
    time, position = alone.time, np.array(trajectory.position, np.float64)
    velocity, orientation = (np.array(part, np.float64) for part in (trajectory.velocity, trajectory.orientation))
    here = position[:, 0] + 1j * position[:, 1]
    there = np.interp(time[mids], together.time, common[:, 0]) + 1j * np.interp(time[mids], together.time, common[:, 1])
    factor = np.ones(max(len(mids) - 1, 1), complex)
    for k, (way, wanted) in enumerate(zip(np.diff(here[mids]), np.diff(there), strict=True)):
        # where a direction is not known: the rotation of the previous stride
        known = min(abs(way), abs(wanted)) > SHORTEST_WAY
        factor[k] = wanted / way if known else (factor[k - 1] if k else 1.0)
    stride = np.clip(np.searchsorted(mids, np.arange(len(time)), side="right") - 1, 0, len(factor) - 1)
    placed = there[stride] + (here - here[mids][stride]) * factor[stride]
    turn = np.angle(factor)[stride]
    position = np.stack([placed.real, placed.imag, position[:, 2]], axis=1)
    return FootTrajectory(position, turned(velocity, turn), yawed(orientation, turn))


def _matches(ours: Strides, theirs: Strides) -> np.ndarray:
    """(n,) row of the filter for each stride, −1 for none."""
    middle, side = 0.5 * (as_float(ours.standing) + as_float(ours.standing_end)), np.asarray(ours.side)
    inside = (as_float(theirs.standing) < middle[:, None]) & (middle[:, None] < as_float(theirs.standing_end))
    inside &= (side[:, None] == np.asarray(theirs.side)) & np.asarray(theirs.valid, bool)
    return np.max(np.where(inside, np.arange(inside.shape[1]), -1), axis=1, initial=-1)


def _at_doubtful_footholds(strides: Strides, doubtful: Flags) -> np.ndarray:
    """(n,) bool, strides that begin or end at a foothold of a doubtful stride, or pass one of the other foot."""
    side, begin, end = (
        np.asarray(column)[:, None] for column in (strides.side, strides.standing, strides.standing_end)
    )
    rows = np.flatnonzero(doubtful)
    places = np.concatenate([begin[rows, 0], end[rows, 0]])
    same, passed = (begin == places) | (end == places), (begin < places) & (places < end)
    return np.where(side == np.tile(side[rows, 0], 2), same, passed).any(axis=1)
