"""Which assumption moves a number: gradient times stated deviation, of each parameter and of each sensor's calibration.

One reverse pass gives the gradient of the number with respect to the parameters and to the prepared inputs. The effect
of an error of a sensor on the prepared inputs, what standing corrects of it included, is the difference of two runs of
`prepare`; its product with the gradient is the effect on the number. Decisions (stances, contacts, standing) have no
gradient: the effects hold for errors that leave them as they are.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import reduce
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
from jaxtyping import Float, PyTree, PyTreeDef

from jgait.estimators.columns import COLUMNS, QUANTITIES, Column
from jgait.estimators.interface import Estimator, pad
from jgait.estimators.labels import words
from jgait.estimators.programs import bucket, compiled
from jgait.estimators.proportions import SHARE_SD, SHARES
from jgait.estimators.stride_flags import STRIDE_COLUMNS, in_order, regular
from jgait.estimators.waist.params import TAPE_SD
from jgait.geometry.rotation import rotation
from jgait.notes import record
from jgait.params import Stated, check_params, stated
from jgait.simulate.sensors import MPU6000, ImuErrors
from jgait.types import AnyArray, Estimate, Recording, RecordingError, as_float, check_recording

if TYPE_CHECKING:
    import pandas as pd

CALIBRATION = {
    "gyr_scale": ("gyroscope scale", "1", "calibrate the gyroscope"),
    "gyr_bias": ("gyroscope bias", "rad/s", "one more standing"),
    "acc_scale": ("accelerometer scale", "1", "calibrate the accelerometer"),
    "acc_bias": ("accelerometer bias", "m/s²", "calibrate the accelerometer"),
    "mounting": ("mounting", "rad", "mount the sensor more exactly"),
}
"""Error of a sensor, a field of `ImuErrors` → its words, unit, and what removes it."""

JOINTS = {"hip_flexion_range": "hip_angle", "knee_flexion_range": "knee_angle"}
"""Quantity → field of `LegTrajectory`; its range over the recording, mean of the legs."""

SMALL = 1e-3
"""[1] Error of a sensor for which the effect on the prepared inputs is computed, over its deviation; so small that
decisions stay as they are."""


@record
class Assumption(NamedTuple):
    """One assumption, and what it does to a number."""

    name: str  #: parameter, or error of a sensor with its placement.
    deviation: float  #: standard deviation of the assumption, in `unit`; NaN where none is stated.
    unit: str  #: unit of the deviation.
    source: str  #: where the deviation is stated.
    #: standard deviation of the number by this assumption, in SI units; of a parameter with the sign of the gradient;
    #: NaN where no deviation is stated.
    effect: float
    tenth: float  #: change of the number when the parameter grows by a tenth, in SI units; NaN for a sensor.
    share: float  #: share of the variance of the number by all assumptions [1].
    without: float  #: standard deviation of the number if `remedy` were done.
    remedy: str  #: what would reduce it; "" where nothing is known to.

    @property
    def words(self) -> str:
        """The assumption in a reader's words."""
        return words(self.name)


@record
class Explanation(NamedTuple):
    """Which assumptions move a number of a recording."""

    measure: str  #: name of the number, such as "stride_length".
    value: float  #: the number, in the SI unit.
    stddev: float  #: standard deviation of the number by all assumptions with a stated deviation, in the SI unit.
    assumptions: tuple[Assumption, ...]  #: the largest effect first; those without a stated deviation are last.
    estimator: str  #: name of the estimator.

    @property
    def column(self) -> Column:
        """How readers see the number: words, unit, decimal places."""
        return QUANTITIES[self.measure]

    def shown(self, value: float) -> float:
        """A value in SI units, in the unit that readers see."""
        return self.column.scale * value * (180.0 / math.pi if self.column.unit == "deg" else 1.0)

    @property
    def small(self) -> tuple[float, str]:
        """Factor from the SI unit, and the unit, in which readers see effects: centimetres of lengths."""
        return (100.0, "cm") if self.column.unit == "m" else (self.shown(1.0), self.column.shown)

    @property
    def unstated(self) -> tuple[Assumption, ...]:
        """The assumptions that move the number and have no stated deviation."""
        return tuple(a for a in self.assumptions if math.isnan(a.deviation))

    @property
    def sentence(self) -> str:
        """The number, its deviation, and the largest shares."""
        shares = [f"{a.words} {100.0 * a.share:.0f} %" for a in self.assumptions if a.share >= 0.01][:4]
        spread = f"{self.shown(self.stddev):.2g}"
        digits = max(self.column.digits, len(spread.partition(".")[2]))
        value = f"{self.shown(self.value):.{digits}f}"
        return f"{self.column.words} {value} ± {spread} {self.column.shown}: {', '.join(shares) or 'no assumption'}"

    def to_dataframe(self) -> "pd.DataFrame":
        """A row for each assumption; effects in SI units."""
        import pandas as pd

        return pd.DataFrame([a._asdict() for a in self.assumptions])


type _Number = tuple[tuple[str, ...], tuple[np.ndarray, ...]]
"""A number as a weighted sum over an array: the fields of `Estimate` that lead to it (of `Legs`, the sum over both),
and the weights."""


def with_error(recording: Recording, placement: str, error: str, values: npt.ArrayLike) -> Recording:
    """The recording with an error of one sensor, a name of `CALIBRATION`; `values` (3,) are the error of each axis in
    the unit stated there, of "mounting" a rotation vector, by which the sensor is turned.
    """
    imu, by = recording.sensors[placement], as_float(values)
    mask = np.asarray(imu.mask, bool)[:, None]
    matrix = np.asarray(rotation(jnp.asarray(by))) if error == "mounting" else np.eye(3)

    def read(signal: AnyArray, kind: str) -> np.ndarray:
        values = as_float(signal)
        if error == "mounting":
            return values @ matrix
        if not error.startswith(kind):
            return values
        return np.where(mask, values * (1.0 + by) if error.endswith("scale") else values + by, values)

    worn = imu._replace(gyr=read(imu.gyr, "gyr"), acc=None if imu.acc is None else read(imu.acc, "acc"))
    return recording._replace(sensors={**recording.sensors, placement: worn})


def explain(
    estimator: Estimator[PyTree, PyTree], params: PyTree, recording: Recording, measure: str = "stride_length", *,
    sensor: ImuErrors = MPU6000, deviations: Mapping[str, float] | None = None,
    person: Mapping[str, PyTree] | None = None,
) -> Explanation:  # fmt: skip
    """Which assumption moves a number of a recording: gradient times stated deviation, the largest first.

    Deviations of parameters are those that the estimator declares: priors, and parameters that hold deviations. A
    parameter with a value for each leg moves for both at once. One without a stated deviation is listed, with what a
    tenth more of it does. Each axis of a sensor errs by itself.

    Args:
        estimator: from `jgait.estimators`.
        params: its parameters, natural units.
        recording: the signals.
        measure: "distance", a column of strides that has a gradient (mean of the regular strides: "stride_length",
            "walking_speed", "stride_width", "lift", …), or "hip_flexion_range", "knee_flexion_range".
        sensor: deviations of the sensors' calibration: scale and bias of gyroscope and accelerometer, and mounting.
        deviations: parameter → standard deviation in natural units, in place of those that are declared; such as
            standard errors of `identifiability`.
        person: measures of the person from which `params` were made [m]: one that was taken has the deviation of a
            tape; lengths that follow from the "height" have that of people of one height.

    Raises:
        RecordingError: a recording that the estimator cannot use, or without a value of the measure.
        ValueError: an unknown measure or parameter, or one that has no gradient.
    """
    check_recording(recording)
    check_params(params, estimator.transforms, estimator.params)
    prepared = estimator.prepare(recording)
    raw = estimator._replace(in_parts=None).computed(params, prepared)
    path, weights = _number(measure, raw, estimator.finished(raw, prepared), estimator)
    leaves, structure = jax.tree.flatten(pad(prepared.inputs, bucket(len(prepared.inputs.time))))
    flat = [np.asarray(leaf) for leaf in leaves]
    floats = [k for k, leaf in enumerate(flat) if leaf.dtype.kind == "f"]
    value, of_params, slopes = compiled(_slopes)(
        params, [flat[k] for k in floats], flat, weights,
        run=estimator.run, options=prepared.options, path=path, structure=structure, floats=tuple(floats),
    )  # fmt: skip
    assumptions = [
        _of_parameter(name, known, params, of_params, estimator)
        for name, known in _deviations(params, deviations or {}, person or {}).items()
        if name.partition(".")[0] not in estimator.unused
    ]

    bare = jax.tree.leaves(prepared.inputs)  # what padding adds moves nothing
    active = [(k, np.asarray(s)[tuple(map(slice, np.shape(bare[k])))])
              for k, s in zip(floats, slopes, strict=True) if np.any(s)]  # fmt: skip

    def changes(erring: Recording) -> tuple[np.ndarray, np.ndarray]:
        other = jax.tree.leaves(estimator.prepare(erring).inputs)
        parts = [(s, np.asarray(other[k]) - bare[k]) for k, s in active]
        return np.array([np.any(part) for _, part in parts]), np.array([np.vdot(*part) for part in parts])

    assumptions += _of_sensors(recording, sensor, changes)
    return _ranked(measure, float(value), assumptions, estimator.name)


def _of_sensors(
    recording: Recording, sensor: ImuErrors, changes: Callable[[Recording], tuple[np.ndarray, np.ndarray]]
) -> Iterator[Assumption]:
    """The effects of the sensors' errors, from the effect of each input that a recording with errors changes.

    Sensors that change different inputs err at once, so that `prepare` runs as seldom as possible.

    Source: A. R. Curtis, M. J. D. Powell and J. K. Reid, "On the estimation of sparse Jacobian matrices", IMA Journal
    of Applied Mathematics 13(1), 1974.
    """

    def erring(placements: Sequence[str], errors: Mapping[str, npt.ArrayLike]) -> Recording:
        pairs = itertools.product(placements, errors.items())
        return reduce(lambda changed, pair: with_error(changed, pair[0], *pair[1]), pairs, recording)

    every = {error: SMALL * getattr(sensor, error) * np.array([1.0, 0.7, 0.4]) for error in CALIBRATION}
    alone = len(recording.sensors) == 1  # its errors reach all that any error reaches
    reached = {name: np.array(True) if alone else changes(erring([name], every))[0] for name in recording.sensors}
    groups: list[list[str]] = []
    for placement in (name for name, moved in reached.items() if moved.any()):
        apart = (g for g in groups if not any(np.any(reached[placement] & reached[other]) for other in g))
        if (group := next(apart, None)) is None:
            groups.append(group := [])
        group.append(placement)
    for group, (error, (text, unit, remedy)) in itertools.product(groups, CALIBRATION.items()):
        deviation = float(getattr(sensor, error))
        # the angle of the mounting is about a random axis
        each = deviation / math.sqrt(3.0) if error == "mounting" else deviation
        axes = [changes(erring(group, {error: row}))[1] / SMALL for row in SMALL * each * np.eye(3) if each]
        for placement in group:
            effect = math.hypot(*(axis[reached[placement]].sum() for axis in axes))
            name = f"{text}, {placement}"
            yield Assumption(name, deviation, unit, "sensor", effect, math.nan, 0.0, math.nan, remedy)


def _number(measure: str, raw: Estimate, final: Estimate, estimator: Estimator[PyTree, PyTree]) -> _Number:
    """The number as a weighted sum over the padded estimate; the rows and samples that count are those of the final
    estimate.
    """
    last = np.flatnonzero(np.asarray(final.valid, bool))
    if measure == "distance" and raw.distance is not None and last.size:
        return ("distance",), (_at(raw.time, last[[-1, 0]], [1.0, -1.0]),)
    legs = [leg for leg in final.legs if leg is not None]
    if measure in JOINTS and legs and last.size:
        angles = [as_float(getattr(leg, JOINTS[measure]))[last] for leg in legs]
        ends = [last[[np.nanargmax(angle), np.nanargmin(angle)]] for angle in angles]
        weights = np.array([1.0, -1.0]) / len(legs)
        return ("legs", JOINTS[measure]), tuple(_at(raw.time, rows, weights) for rows in ends)
    fields = {} if raw.strides is None else {
        COLUMNS[column].quantity: field for column, (field, _) in STRIDE_COLUMNS.items()
        if field and (values := getattr(raw.strides, field)) is not None and np.any(np.isfinite(values))
    }  # fmt: skip
    if measure not in fields:
        known = [*fields, *["distance"] * (raw.distance is not None), *[*JOINTS] * bool(legs)]
        raise ValueError(f"{estimator.name} has no {measure!r} with a gradient; there are {', '.join(known) or 'none'}")
    column, values = QUANTITIES[measure].name, getattr(raw.strides, fields[measure])
    valid = np.asarray(raw.strides.valid, bool)
    rows = np.flatnonzero(valid)
    rows = rows[np.argsort(as_float(raw.strides.end)[rows], kind="stable")]
    counted = in_order(final)[regular(final, estimator.about.flags, column)]
    rows = rows[counted] if len(rows) == np.size(final.strides.valid) else rows
    rows = rows[np.isfinite(as_float(values)[rows])]
    if not rows.size:
        raise RecordingError(f"no regular stride has a {QUANTITIES[measure].words}")
    return ("strides", fields[measure]), (_at(values, rows, 1.0 / rows.size),)


def _at(like: AnyArray, rows: npt.ArrayLike, weights: npt.ArrayLike) -> np.ndarray:
    """Weights of some entries of an array, else zero."""
    whole = np.zeros(np.shape(like))
    whole[np.asarray(rows)] = weights
    return whole


def _slopes(
    params: PyTree, reals: list[AnyArray], leaves: list[AnyArray], weights: tuple[Float[AnyArray, "entry"], ...], *,
    run: Callable[..., Estimate], options: PyTree, path: tuple[str, ...], structure: PyTreeDef, floats: tuple[int, ...],
) -> tuple[AnyArray, PyTree, list[AnyArray]]:  # fmt: skip
    """The number, and its gradients with respect to the parameters and to the real numbers among the inputs' leaves."""

    def number(params: PyTree, reals: list[AnyArray]) -> AnyArray:
        whole = dict(enumerate(leaves)) | dict(zip(floats, reals, strict=True))
        inputs = jax.tree.unflatten(structure, [whole[k] for k in range(len(leaves))])
        value = getattr(run(params, inputs, options), path[0])
        parts = [part for part in value if part is not None] if path[0] == "legs" else [value]
        arrays = [getattr(part, path[1]) if len(path) > 1 else part for part in parts]
        terms = [jnp.sum(jnp.where(w != 0.0, w * a, 0.0)) for w, a in zip(weights, arrays, strict=True)]
        return sum(terms[1:], terms[0])

    value, (of_params, of_reals) = jax.value_and_grad(number, argnums=(0, 1))(params, reals)
    return value, of_params, of_reals


def _deviations(params: PyTree, given: Mapping[str, float], person: Mapping[str, PyTree]) -> dict[str, Stated]:
    """The deviation of each parameter: given, of a tape, by the proportions of people of one height, or declared."""
    known = stated(params)
    if unknown := [name for name in given if name not in known]:
        raise ValueError(f"there is no parameter {unknown[0]!r}; there are {', '.join(known)}")
    for name, declared in known.items():
        if name in given:
            known[name] = Stated(float(given[name]), declared.unit, "given")
        elif name in person:
            known[name] = Stated(TAPE_SD, declared.unit, "tape")
        elif name in SHARES and "height" in person and math.isnan(declared.deviation):
            known[name] = Stated(SHARE_SD * float(person["height"]), declared.unit, "proportions")
    return known


def _of_parameter(
    name: str, known: Stated, params: PyTree, slopes: PyTree, estimator: Estimator[PyTree, PyTree]
) -> Assumption:
    """The effect of one parameter, of both legs together."""
    value, slope = (jax.tree.leaves(reduce(getattr, name.split("."), tree)) for tree in (params, slopes))
    total = np.asarray(sum(map(np.asarray, slope)))
    effect = float(total) * known.deviation if total.ndim == 0 else known.deviation * float(np.linalg.norm(total))
    tenth = 0.1 * sum(float(np.sum(np.asarray(v) * np.asarray(s))) for v, s in zip(value, slope, strict=True))
    measured = {m.parameter or m.name for m in estimator.about.measures if m.unit == "m"}
    remedy = "measure it" if name in measured else ""
    return Assumption(name, known.deviation, known.unit, known.source, effect, tenth, 0.0, math.nan, remedy)


def _ranked(measure: str, value: float, assumptions: list[Assumption], estimator: str) -> Explanation:
    """The explanation, with shares, and deviations without each assumption."""
    variance = sum(a.effect**2 for a in assumptions if not math.isnan(a.deviation))
    rows = []
    for a in assumptions:
        if not math.isnan(a.deviation) and a.effect:
            # a measure that is taken is known to a centimetre
            left = min(TAPE_SD / a.deviation, 1.0) if a.remedy == "measure it" else 0.0
            rest = math.sqrt(max(variance - (1.0 - left**2) * a.effect**2, 0.0))
            rows.append(a._replace(share=a.effect**2 / variance, without=rest))
        elif math.isnan(a.deviation) and a.tenth:
            rows.append(a)
    rows.sort(key=lambda a: (-a.share, -abs(np.nan_to_num(a.tenth))))
    return Explanation(measure, value, math.sqrt(variance), tuple(rows), estimator)
