"""Laws that every registered estimator keeps, on two short walks of its own (`made.estimators`).

Most of the time goes into compiling, so the laws share programs: that of every recording, one in single precision, and
one of a batch of shorter inputs with the derivative along a direction of the parameters, in two where that takes less.
"""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made.estimators import CASES, OTHER_OPTIONS, Case, behind, lossy, part, with_values

from jgait import estimators, params, tune
from jgait.estimators import programs
from jgait.estimators.interface import pad, trimmed
from jgait.tune import LOSSES, Lesson
from jgait.tune.checks import start
from jgait.tune.problem import Items, Problem, item_losses
from jgait.tune.remainder import reduced

ANGLE = ".diagnostics['angle_"
every_estimator = pytest.mark.parametrize("name", estimators.names())
RARE = {"ankle_stride", "foot_ins", "leg_ekf", *OTHER_OPTIONS}
"""Estimators whose batches, derivatives and single precision belong to the release group: they compile for minutes."""


def often_unless_rare(*more: str) -> pytest.MarkDecorator:
    """Each estimator, and more cases, of which the rare ones belong to the release group."""
    names = (*estimators.names(), *more)
    marks = {name: [pytest.mark.release] * (name in RARE) for name in names}
    return pytest.mark.parametrize("name", [pytest.param(name, marks=marks[name]) for name in names])


# --- what the laws share ---


@functools.cache
def case_of(name: str) -> Case:
    return (CASES | OTHER_OPTIONS)[name]()


def run_of(name: str) -> Callable[..., Any]:
    return estimators.get(name.split()[0]).run


def doubles(tree: Any) -> Any:
    return jax.tree.map(jnp.asarray, tree)


def singles(tree: Any) -> Any:
    return jax.tree.map(lambda v: v.astype(jnp.float32) if v.dtype == jnp.float64 else v, doubles(tree))


def estimated(name: str, inputs: Any) -> Any:
    """The estimate by the program that users run, padded as it pads."""
    case = case_of(name)
    padded = pad(inputs, programs.bucket(inputs.time.size))
    return programs.compiled(run_of(name))(case.params, padded, options=case.options)


@functools.cache
def estimates(name: str) -> tuple[Any, ...]:
    return tuple(estimated(name, inputs) for inputs in case_of(name).inputs)


@functools.cache
def batch(name: str) -> Any:
    """The estimates of both walks side by side, with less padding behind them."""
    case, run = case_of(name), run_of(name)
    if case.light == case.options:  # the program of the derivatives computes them beside
        _, values, _ = parameters(name)
        rows = np.tile(values, (2, 1))
        return derivatives(name, rows, 0.0 * rows, np.arange(2))[2]
    stacked = jax.tree.map(lambda *v: np.stack(v), *case.inputs)
    return jax.jit(jax.vmap(lambda inputs: run(case.params, inputs, case.options)))(stacked)


def bare(name: str, number: int, result: Any) -> dict[str, np.ndarray]:
    """Path → array of an estimate of the walk with this number, without padding."""
    record, case = estimators.get(name), case_of(name)
    result = trimmed(result, case.samples[number], record.per_stride)
    if record.finish is not None:
        notes = {"notes": (), "standing": None, "sensors": case.prepared[number].quality}
        result = record.finish(result._replace(diagnostics={**result.diagnostics, **notes}), case.prepared[number])
        result = result._replace(diagnostics={k: v for k, v in result.diagnostics.items() if k not in notes})
    leaves, _ = jax.tree_util.tree_flatten_with_path(result)
    return {jax.tree_util.keystr(path): np.asarray(leaf) for path, leaf in leaves}


def assert_close(ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray], share: float) -> None:
    """Equal but for rounding: a share of the largest value of each array; flags and counts are equal."""
    assert ours.keys() == theirs.keys()
    for path, value in ours.items():
        size = np.max(np.abs(value), initial=1.0, where=np.isfinite(value)) if value.dtype.kind == "f" else 0.0
        np.testing.assert_allclose(value, theirs[path], rtol=0.0, atol=share * size, err_msg=path)


def assert_equal(ours: Any, theirs: Any) -> None:
    jax.tree.map(np.testing.assert_array_equal, ours, theirs)


# --- losses ---


def displaced(result: Any) -> Any:
    """An estimate as its own reference, with every quantity off: by 1 cm, 1° or 10 ms, paths by a bend."""
    bend = None if result.feet is None else np.linspace(0.0, 1.0, result.time.size)[:, None] ** 2
    moved = {
        "legs": jax.tree.map(lambda v: v + np.linspace(0.0, 0.03, v.size), result.legs),
        "distance": None if result.distance is None else 1.01 * result.distance,
        "feet": jax.tree.map(lambda v: v + bend if v.shape[-1] == 3 else v, result.feet),
        "strides": None if result.strides is None else jax.tree.map(lambda v: v, result.strides)._replace(
            **{f: getattr(result.strides, f) + 0.01 for f in ("length", "width", "height", "end")}
        ),
    }  # fmt: skip
    return result._replace(valid=np.ones(result.time.size, bool), **moved)


@every_estimator
def test_the_losses_of_the_record_are_those_that_its_estimates_answer(name):
    case, result = case_of(name), jax.tree.map(np.asarray, estimates(name)[0])
    samples = case.samples[0]
    everywhere = np.arange(result.time.size) < samples
    inputs = pad(case.inputs[0], result.time.size)
    lesson = Lesson(inputs, displaced(result), everywhere, ~everywhere, np.asarray(0), np.asarray(samples - 1), {})
    losses = set(estimators.about_of(name).losses or ())
    if name == "duty_cycled_gyro":
        losses &= {"likelihood"}  # its walk has a single segment, so no leg
    by_distance = {"stride_length"} if result.strides is None else set()  # references with strides come from elsewhere
    terms = {loss: functools.partial(LOSSES[loss].term, lesson=lesson) for loss in LOSSES.keys() - by_distance}
    for loss in [*terms]:
        try:
            jax.eval_shape(terms[loss], result)
        except ValueError:
            assert loss not in losses
            del terms[loss]
    values = jax.jit(lambda result: {loss: term(result) for loss, term in terms.items()})(result)
    for loss, value in values.items():
        assert np.isfinite(value)
        assert (float(value) != 0.0) == (loss in losses), loss


READ_OUT = {
    "leg_ekf": ("distance", "distance_scale"), "foot_ins": ("position", "tracked_point.x"),
    "ankle_stride": ("calibration", "stride_noise"), "waist_ofdri": ("calibration", "acc_bias"),
}  # fmt: skip
"""Estimator → a loss, and a parameter of the read-out on which it depends."""


@pytest.mark.parametrize("name", READ_OUT)
def test_tuning_computes_once_what_a_parameter_of_the_read_out_leaves_as_it_is(name):
    case, record, (loss, parameter) = case_of(name), estimators.get(name), READ_OUT[name]
    samples, result = case.samples[0], jax.tree.map(np.asarray, estimates(name)[0])
    everywhere = np.arange(result.time.size) < samples
    inputs = pad(case.inputs[0], result.time.size)
    ends = [np.asarray(samples - 1), np.asarray(samples - 40)]
    lessons = [Lesson(inputs, displaced(result), everywhere, ~everywhere, np.asarray(0), end, {}) for end in ends]
    ranges = params.freed(record.transforms, parameter)
    whole = Problem(tune.objective(record, case.options, loss), ranges, None, None)
    free = start(case.params, ranges)
    items = Items(jax.tree.map(lambda *v: np.stack(v), *lessons), np.zeros(2, np.int32))
    part, left, _ = reduced(whole, case.params, free, items)
    assert part.loss is not whole.loss
    moved = jax.tree.map(lambda v: v + 0.1, free)
    at = params.constrain(moved, ranges, case.params)
    expected = [float(whole.loss(jax.tree.map(np.asarray, at), one)) for one in lessons]
    np.testing.assert_allclose(item_losses(part, moved, case.params, left), expected, rtol=1e-9)
    assert not np.allclose(item_losses(part, free, case.params, left), expected, rtol=1e-6)


# --- compiled, mapped, padded, masked ---


@every_estimator
def test_a_recording_of_another_length_compiles_nothing(name, compiled):
    case = case_of(name)
    record = estimators.get(name, options=case.options) if name == "duty_cycled_gyro" else estimators.get(name)
    first, *ready = case.prepared
    record.solve(case.params, first)
    compiled.clear()
    if case.recording is not None:
        ready.append(case.prepare(part(case.recording, slice(-77))))
    assert len({made.inputs.time.size for made in (first, *ready)}) > 1
    for made in ready:
        assert made.options == case.options
        found = record.solve(case.params, made)
        assert found.time.size == made.inputs.time.size
    assert compiled == []


@often_unless_rare()
def test_vmap_equals_a_loop_and_more_padding_changes_nothing(name):
    for number, alone in enumerate(estimates(name)):
        row = jax.tree.map(lambda v, number=number: v[number], batch(name))
        assert_close(bare(name, number, row), bare(name, number, alone), 1e-8)


@every_estimator
def test_padding_is_not_valid_and_its_values_are_inert(name):
    case = case_of(name)
    for number, inputs in enumerate(case.inputs):
        assert not np.any(estimates(name)[number].valid[case.samples[number] :])
        spoilt = with_values(inputs, behind(case.samples[number], inputs.time.size), 7.0)
        assert_close(bare(name, number, estimated(name, spoilt)), bare(name, number, estimates(name)[number]), 1e-12)


@every_estimator
def test_masked_samples_of_the_inputs_are_inert(name):
    inputs = case_of(name).inputs[0]
    one, other = (estimated(name, with_values(inputs, None, value)) for value in (0.0, 30.0))
    assert_equal(one, other)


@every_estimator
def test_lost_samples_of_a_recording_are_inert(name):
    case = case_of(name)
    if case.recording is None:
        pytest.skip("its inputs are not made of a recording")
    made = [case.prepare(lossy(case.recording, value)) for value in (0.0, 30.0)]
    assert made[0].options == made[1].options == case.options
    one, other = (estimated(name, pad(ready.inputs, case.inputs[0].time.size)) for ready in made)
    assert_equal(one, other)


@every_estimator
def test_a_compiled_program_does_not_depend_on_the_values_that_were_there_when_it_was_traced(name):
    """Parameters whose values are known make the same operations as unknown ones."""
    case, run = case_of(name), run_of(name)
    p, inputs = doubles(case.params), doubles(case.inputs[0])
    known = jax.make_jaxpr(lambda inputs: run(p, inputs, case.options))(inputs)
    unknown = jax.make_jaxpr(lambda p, inputs: run(p, inputs, case.options))(p, inputs)
    assert operations(known.jaxpr) == operations(unknown.jaxpr)


def operations(jaxpr: Any) -> list[str]:
    """Names of the primitives of a program in order, those of inner programs among them."""
    out = []
    for equation in jaxpr.eqns:
        out.append(equation.primitive.name)
        for inner in jax.tree.leaves(list(equation.params.values()), is_leaf=lambda node: hasattr(node, "eqns")):
            if hasattr(inner, "eqns"):
                out += operations(inner)
    return out


# --- precision and derivatives ---


@often_unless_rare()
def test_single_precision_stays_single_and_is_near_to_double(name):
    case = case_of(name)
    padded = pad(case.inputs[0], programs.bucket(case.inputs[0].time.size))
    single = programs.compiled(run_of(name))(singles(case.params), singles(padded), options=case.options)
    assert {leaf.dtype for leaf in jax.tree.leaves(single) if leaf.dtype.kind == "f"} == {np.dtype(np.float32)}
    ours, theirs = (bare(name, 0, result) for result in (single, estimates(name)[0]))
    for path, value in ours.items():
        if value.dtype.kind == "f":
            assert np.array_equal(np.isfinite(value), np.isfinite(theirs[path])), path
        if path.startswith(
            (".legs", ".distance", ".strides.length", ".strides.width", ".strides_stddev", ".feet.", ANGLE)
        ):
            np.testing.assert_allclose(value, theirs[path], rtol=0.0, atol=case.rounding, err_msg=path)


@functools.cache
def derivative_program(name: str) -> Callable[..., Any]:
    """Rows of parameters, directions (K, n) and inputs → numbers, their derivative and the estimate for each row."""
    case, run = case_of(name), run_of(name)
    tree = jax.tree.structure(case.params)

    def f(v: Any, i: Any) -> tuple[dict[str, Any], Any]:
        method = dataclasses.replace(case.light.method, derivative="forward")
        result = run(jax.tree.unflatten(tree, list(v)), i, case.light._replace(method=method))
        return numbers(result), result

    def slope(v: Any, w: Any, i: Any) -> Any:
        return jax.jvp(lambda x: f(x, i), (v,), (w,), has_aux=True)

    # What runs for seconds without LLVM's optimisations compiles in less than they save.
    long = case.light != case.options
    return jax.jit(jax.vmap(slope), compiler_options={"xla_backend_optimization_level": 1} if long else None)


def numbers(result: Any) -> dict[str, Any]:
    """Path → floating-point array of an estimate, 0 where it is not finite, or belongs to padding among strides."""
    strides = result.strides
    if strides is not None:

        def there(table: Any) -> Any:
            return jax.tree.map(lambda v: jnp.where(strides.valid, v, 0.0) if v.dtype.kind == "f" else v, table)

        result = result._replace(strides=there(strides), strides_stddev=there(result.strides_stddev))
    leaves, _ = jax.tree_util.tree_flatten_with_path(result)
    floats = {jax.tree_util.keystr(path): jnp.asarray(leaf) for path, leaf in leaves}
    return {path: jnp.where(jnp.isfinite(v), v, 0.0) for path, v in floats.items() if v.dtype.kind == "f"}


def parameters(name: str) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names and values of the parameters, and the size of a change of each."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(case_of(name).params)
    values = np.array([leaf for _, leaf in leaves], float)
    names = [jax.tree_util.keystr(path).lstrip(".") for path, _ in leaves]
    return names, values, np.where(values != 0.0, values, 0.01)


ROWS = 8
"""Rows that the program of the derivatives computes at once."""


def derivatives(name: str, values: np.ndarray, ways: np.ndarray, walks: np.ndarray) -> tuple[Any, ...]:
    """Numbers, derivatives and estimates: a row for each row of parameters, directions and numbers of walks."""
    program, inputs, found = derivative_program(name), case_of(name).inputs, []
    for first in range(0, len(values), ROWS):
        rows = np.minimum(first + np.arange(ROWS), len(values) - 1)
        stacked = jax.tree.map(lambda *v: np.stack(v), *(inputs[walk] for walk in walks[rows]))
        found.append(jax.tree.map(np.asarray, program(values[rows], ways[rows], stacked)))
    return jax.tree.map(lambda *parts: np.concatenate(parts)[: len(values)], *found)


def along(name: str, values: np.ndarray, ways: np.ndarray, number: int = 0) -> tuple[dict[str, np.ndarray], ...]:
    """Numbers of an estimate and their derivatives, a row for each row of parameters and directions."""
    return derivatives(name, values, ways, np.full(len(values), number))[:2]


@functools.cache
def slopes(name: str) -> dict[str, np.ndarray]:
    """Derivatives of the estimate of the first walk: a row for each parameter, for a change of its own size."""
    _, values, size = parameters(name)
    return along(name, np.tile(values, (len(size), 1)), np.diag(size))[1]


def without_effect(name: str) -> set[str]:
    """Parameters whose gradient is zero by construction, by the estimator's own list."""
    record = estimators.get(name.split()[0], *([case_of(name).options] if name in OTHER_OPTIONS else []))
    names = parameters(name)[0]
    return {n for n in names if any(n == group or n.startswith(f"{group}.") for group in record.unused)}


def moving(found: dict[str, np.ndarray]) -> np.ndarray:
    """Which rows of derivatives are not zero everywhere."""
    return np.any([np.any(v.reshape(len(v), -1) != 0.0, axis=1) for v in found.values()], axis=0)


@often_unless_rare(*OTHER_OPTIONS)
def test_the_gradient_is_zero_for_the_listed_parameters_and_no_others(name):
    names, values, size = parameters(name)
    moves = moving(slopes(name))
    idle = np.flatnonzero(~moves)  # on the first walk
    if idle.size:
        moves[idle] = moving(along(name, np.tile(values, (idle.size, 1)), np.diag(size)[idle], 1)[1])
    found = {n for n, moved in zip(names, moves, strict=True) if moved}
    idle = {n for n in names if n.startswith(case_of(name).idle)} if case_of(name).idle else set()
    assert found == set(names) - without_effect(name) - idle


@often_unless_rare(*OTHER_OPTIONS)
def test_gradients_are_finite_and_equal_to_finite_differences(name):
    names, values, size = parameters(name)
    h, moves = 1e-5, np.flatnonzero(moving(slopes(name)))
    changes = h * np.diag(size)[moves]
    moved = np.concatenate([values + changes, values - changes])
    both = along(name, moved, 0.0 * moved)[0]
    up, down = (
        {path: half[part] for path, half in both.items()} for part in (slice(moves.size), slice(moves.size, None))
    )
    for path, slope in slopes(name).items():
        assert np.all(np.isfinite(slope)), path
        for row, k in enumerate(moves):
            by_hand = (up[path][row] - down[path][row]) / (2.0 * h)
            rounding = 1e-6 * max(1.0, float(np.max(np.abs(up[path][row]), initial=0.0)))
            most = 2e-4 * float(np.max(np.abs(slope[k]), initial=0.0)) + rounding
            np.testing.assert_allclose(slope[k], by_hand, rtol=0.0, atol=most, err_msg=f"{path} by {names[k]}")


# --- what an estimator states about itself ---


def is_transform(node: Any) -> bool:
    return isinstance(node, params.Transform)


@every_estimator
def test_every_parameter_declares_range_unit_and_meaning(name):
    made = estimators.get(name)
    units = params.units(made.params)
    assert tuple(units) == params.names(made.transforms) and all(units.values())
    declared = params.declared(type(made.params))
    assert tuple(declared) == made.params._fields
    for field, one in declared.items():
        assert len(one.meaning) > 10 and f"    {field}: {one.meaning}" in type(made.params).__doc__
    params.check_params(made.params, made.transforms)
    assert jax.tree.structure(made.transforms, is_leaf=is_transform) == jax.tree.structure(made.params)


@every_estimator
def test_every_option_is_documented(name):
    default = estimators.get(name).about.default
    for field in default._fields:
        assert f"\n        {field}: " in type(default).__doc__, field


@every_estimator
def test_an_estimator_states_its_title_needs_and_tables(name):
    record = estimators.get(name)
    about = record.about
    assert record.name == name
    assert estimators.about_of(name) == about
    assert about.title and about.needs and about.tables
    assert about.default is not None and (about.paper is None or type(about.paper) is type(about.default))
    assert all(measure.unit and measure.meaning and measure.low < measure.high for measure in about.measures)
    assert all(option.help and option.name.startswith("--") for option in about.options)
    assert all(flag.meaning and flag.label for flag in about.flags)


@every_estimator
def test_a_measure_that_no_estimator_knows_is_refused_with_the_known_ones(name):
    record = estimators.get(name)
    with pytest.raises(ValueError, match="of a person; got 'mass'") as refused:
        record.with_body(record.params, {"mass": 70.0})
    assert [m.name for m in record.about.measures if m.name not in str(refused.value)] == []


@every_estimator
def test_a_parameter_outside_its_range_is_refused_by_name(name):
    record, case = estimators.get(name), case_of(name)
    if case.recording is None:
        pytest.skip("its inputs are not made of a recording")
    flat, tree = jax.tree.flatten(record.transforms, is_leaf=is_transform)
    for k, (parameter, transform) in enumerate(zip(parameters(name)[0], flat, strict=True)):
        values = [float(v) for v in jax.tree.leaves(record.params)]
        values[k] = transform.high if math.isfinite(transform.high) else transform.low
        if math.isfinite(values[k]):
            with pytest.raises(ValueError, match=f"parameter '{parameter}' must lie in"):
                record.estimate(jax.tree.unflatten(tree, values), case.recording)
