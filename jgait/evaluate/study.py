"""What a study would measure with other sensors: the errors of set-ups, from simulated people or from a recording.

A set-up is a choice of sensors: where, at which rate, with which ranges, with the gyroscopes off part of the time, for
how long. Walks of full quality are degraded to each set-up, estimated, and compared with their truth: that of the
simulator, or the estimate at full quality.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np
from jaxtyping import PRNGKeyArray, PyTree

from jgait import simulate
from jgait.duty_cycle import power
from jgait.duty_cycle.recording import fill_recording
from jgait.estimators.checks import sensors_of
from jgait.estimators.columns import QUANTITIES
from jgait.estimators.combined import MEASURES
from jgait.estimators.combined.sources import WAYS
from jgait.estimators.interface import Estimator
from jgait.estimators.stride_flags import STRIDE_COLUMNS
from jgait.evaluate.cohort import cohort
from jgait.notes import record
from jgait.simulate.sensors import ON_SHOE, ImuErrors
from jgait.types import AnyArray, Imu, Recording, RecordingError, Walk, as_float, check_recording

if TYPE_CHECKING:
    import pandas as pd


@record
class Setup(NamedTuple):
    """A choice of sensors."""

    placements: tuple[str, ...]  #: where they are worn, see `jgait.PLACEMENTS`.
    rate_hz: float = 100.0  #: sampling rate [Hz].
    acc_range: float = math.inf  #: largest specific force that an accelerometer reads [m/s²].
    gyr_range: float = math.inf  #: largest rate that a gyroscope reads [rad/s].
    duty: float = 1.0  #: share of the time in which the gyroscopes of shanks are on [1], in units of 1.4 s.
    seconds: float = math.inf  #: length of the recording [s].


def setups(**choices: Iterable[PyTree]) -> list[Setup]:
    """All combinations of choices: field of `Setup` → its values, `placements` among them."""
    return [Setup(**dict(zip(choices, row, strict=True))) for row in itertools.product(*choices.values())]


def degraded(recording: Recording, setup: Setup) -> Recording:
    """A recording as the sensors of a set-up would have made it: means over the interval of the lower rate, clipped at
    the ranges.

    Raises RecordingError if it lacks a sensor or its rate is too low, ValueError for a duty cycle without a schedule.
    """
    check_recording(recording)
    if missing := [name for name in setup.placements if name not in recording.sensors]:
        raise RecordingError(f"the set-up needs '{missing[0]}'; {sensors_of(recording)}")
    if setup.rate_hz > 1.01 * recording.sampling_rate_hz:
        raise RecordingError(f"the recording has {recording.sampling_rate_hz:g} Hz, less than {setup.rate_hz:g} Hz")
    sensors = {name: _sampled(recording.sensors[name], setup) for name in setup.placements}
    made = recording._replace(sensors=sensors, sampling_rate_hz=setup.rate_hz, feet_range=None)
    return fill_recording(made, schedule=setup.duty) if setup.duty < 1.0 else made


def _sampled(imu: Imu, setup: Setup) -> Imu:
    """The sensor at the rate of the set-up, each sample the mean over an interval around it, and with its ranges."""
    time, mask, every = as_float(imu.time), np.asarray(imu.mask, bool), 1.0 / setup.rate_hz
    kept = time <= time[0] + setup.seconds
    same = abs(every / float(np.median(np.diff(time))) - 1.0) < 0.01
    grid = time[kept] if same else np.arange(time[0] + 0.5 * every, time[kept][-1] - 0.5 * every, every)
    near = mask[np.clip(np.searchsorted(time, grid), 0, time.size - 1)]

    def read(signal: AnyArray, limit: float) -> np.ndarray:
        columns = []
        for values in as_float(signal).T:
            whole = np.interp(time, time[mask], values[mask])
            integral = np.concatenate([[0.0], np.cumsum(0.5 * (whole[1:] + whole[:-1]) * np.diff(time))])
            ends = (np.interp(grid + side * every, time, integral) for side in (0.5, -0.5))
            columns.append(whole[kept] if same else (next(ends) - next(ends)) / every)
        return np.where(near[:, None], np.clip(np.stack(columns, axis=1), -limit, limit), 0.0)

    return Imu(grid, read(imu.gyr, setup.gyr_range), None if imu.acc is None else read(imu.acc, setup.acc_range), near)


def estimator_of(recording: Recording) -> Estimator[PyTree, PyTree]:
    """The estimator of the first source of `analyse` that has its sensors. Raises RecordingError if there is none."""
    way = next((way for way in WAYS if way.uses(recording)), None)
    if way is None:
        raise RecordingError(f"no estimator has its sensors; {sensors_of(recording)}")
    return way.make()


def people(
    key: PRNGKeyArray, n: int = 50, *, metres: float = 30.0, gait: str | None = None, sensor: ImuErrors = ON_SHOE,
    placements: Sequence[str] = simulate.SEVEN, rate_hz: float = 200.0,
) -> list[Walk]:  # fmt: skip
    """Simulated walks of `n` people like those of a study, of full quality, with their truth and body measures.

    People, drawn from published norms, walk `metres` [m] straight ahead, with a gait of `jgait.simulate.GAITS`, such as
    "hemiparetic", or the usual one. A set-up changes rate and ranges of the sensors alone: `rate_hz` is the highest
    rate of all set-ups [Hz].

    Raises:
        ValueError: as `simulate.walks`.
    """
    who, how = jax.random.split(key)
    drawn, route = simulate.population(who, n), simulate.straight(metres)
    keys = [jax.random.fold_in(how, i) for i in range(n)]
    persons = [simulate.person_of(drawn, i) for i in range(n)]
    persons = [person if gait is None else simulate.walking(person, gait) for person in persons]
    fit = [simulate.covering(*pair, route) for pair in zip(keys, persons, strict=True)]
    walks = simulate.walks(keys, fit, [route] * n, sensor, rate_hz, placements)
    bodies = [{name: float(getattr(p.body, name)) for name in ("thigh_length", "shank_length", "sensor_height")}
              for p in fit]  # fmt: skip
    return [
        Walk(recording, true.estimate, {"body": body}) for (recording, true), body in zip(walks, bodies, strict=True)
    ]


def own_truth(recording: Recording, setup: Setup, person: Mapping[str, PyTree] | None = None) -> Walk:
    """A recording with its estimate at full quality as truth, by the sensors of a set-up at their own rate; `plan` adds
    its standard deviations to the changes that a set-up makes. Raises RecordingError if its estimator cannot use it.
    """
    full = degraded(recording, Setup(setup.placements, recording.sampling_rate_hz))
    estimator, body = estimator_of(full), dict(person or {})
    p = estimator.with_body(estimator.params, _known(estimator, body))
    return Walk(recording, estimator.estimate(p, full), {"body": body})


def _known(estimator: Estimator[PyTree, PyTree], body: Mapping[str, PyTree]) -> dict[str, PyTree]:
    """The measures of a person that an estimator takes."""
    return {name: value for name, value in body.items() if name in MEASURES.get(estimator.name, ())}


def plan(
    walks: Sequence[Walk], choices: Sequence[Setup], measure: str = "stride_length", *, people: int = 1
) -> "pd.DataFrame":
    """The errors of a measure of strides, such as "stride_length", that set-ups would give; a row each.

    The walks, of full quality with their truth, are from `people` or `own_truth`; the mean of `people` people is asked.

    Returns:
        The fields of `Setup`; `estimator`; `walks` that could be estimated and `strides`; in SI units, but angles in
        degrees, `bias` and `sd` of the error of a person's mean, `stride_rmse` of single strides, and `expected`, the
        error of the mean of `people` people, √(bias² + sd² / people), with the stated deviation of an own truth;
        `expected_sd`, its standard deviation with so many walks, of one walk with so many strides; `sd` of one is NaN;
        `coverage`: share of strides within two stated deviations [1]; `gyr_power`, mean power of a gyroscope as
        `duty_cycle.power` states it [W]; `reason` why walks failed, or "".

    Raises:
        ValueError: an unknown measure, or no walks.
    """
    import pandas as pd

    column = QUANTITIES[measure].name if measure in QUANTITIES else ""
    if column not in STRIDE_COLUMNS or not walks:
        known = [name for name, column in QUANTITIES.items() if column.name in STRIDE_COLUMNS]
        raise ValueError(f"measure must be one of {', '.join(known)}, of one walk or more; got {measure!r}")
    return pd.DataFrame([{**setup._asdict(), **_row(walks, setup, column, people)} for setup in choices])


def _row(walks: Sequence[Walk], setup: Setup, column: str, people: int) -> dict[str, PyTree]:
    """The errors of one set-up."""
    made: list[Walk] = []
    row: dict[str, PyTree] = {"estimator": "", "walks": 0, "strides": 0, "reason": ""}
    row["gyr_power"] = power.mean_power(power.schedule_of_duty(setup.duty))
    for walk in walks:
        try:
            worn = degraded(walk.recording, setup)
            estimator = estimator_of(worn)
            made.append(walk._replace(recording=worn))
        except RecordingError as error:
            row["reason"] = str(error)
    if not made:
        return row
    done = cohort(estimator, made, body=lambda walk: _known(estimator, walk.info.get("body", {})))
    if len(done.failures):
        row["reason"] = str(done.failures["reason"].iloc[0])
    table = done.strides[(done.strides["quantity"] == column) & done.strides["regular"].astype(bool)]
    errors = table["error"].dropna().to_numpy(float)
    if not errors.size:
        return row
    each = table.groupby("recording")["error"].mean().dropna()
    bias, sd = float(each.mean()), float(each.std(ddof=1))
    spread = np.nan_to_num(sd)
    within = done.quantities[done.quantities["quantity"] == f"{column.rpartition('_')[0]}_within_2sd_percent"]
    of_truth = math.sqrt(np.mean([_stated(walk, column) ** 2 for walk in made]))
    expected = math.sqrt(bias**2 + (spread**2 + of_truth**2) / people)
    # of the bias, sd²/n, of one walk that of its strides, and of the variance of people, 2 sd⁴/(n − 1)
    of_bias = sd / math.sqrt(len(each)) if len(each) > 1 else float(np.std(errors)) / math.sqrt(errors.size)
    doubt = math.hypot(bias * of_bias, spread**2 / people / math.sqrt(2.0 * max(len(each) - 1, 1)))
    return row | {
        "estimator": estimator.name, "walks": len(each), "strides": errors.size, "bias": bias, "sd": sd,
        "stride_rmse": math.hypot(math.sqrt(np.mean(errors**2)), of_truth),
        "expected": expected, "expected_sd": doubt / expected if expected else math.nan,
        "coverage": float(within["estimate"].mean()) / 100.0 if len(within) else math.nan,
    }  # fmt: skip


def _stated(walk: Walk, column: str) -> float:
    """Root mean square of the stated deviations of the truth's strides; 0 of an exact truth."""
    truth, (field, factor) = walk.reference, STRIDE_COLUMNS[column]
    if truth is None or truth.strides is None or (spread := getattr(truth.strides_stddev, field or "-", None)) is None:
        return 0.0
    known = as_float(spread)[np.asarray(truth.strides.valid, bool)]
    return factor * math.sqrt(np.nanmean(known**2)) if np.isfinite(known).any() else 0.0
