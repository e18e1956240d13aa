"""Programs are kept between processes."""

import threading
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jgait.estimators import programs
from jgait.estimators.staged import staged

announced: list[str] = []


def times(x: Any, *, options: float) -> Any:
    return lax.map(lambda value: options * np.pi * value, x)  # a loop, which is compiled


@pytest.fixture
def folder(tmp_path):
    programs.keep(tmp_path)
    programs.before_compiling(lambda: announced.append("compiling"))
    yield tmp_path
    programs.before_compiling(None)
    programs.keep(None)


def made(x: Any, options: float = 2.0) -> Any:
    """The result of a program that is new to this process."""
    announced.clear()
    return programs.Program(times)(x, options=options)


def unknown() -> float:
    """Options of a program that no cache has."""
    return float(np.random.default_rng().random())


def test_a_kept_program_is_loaded_and_not_compiled(folder):
    x = np.arange(5.0)
    options = unknown()
    first = made(x, options)
    assert announced
    np.testing.assert_array_equal(made(x, options), first)
    assert announced == []
    made(x, unknown())
    assert announced  # other options, and below another shape
    made(np.arange(6.0), options)
    assert announced
    assert len(list(folder.iterdir())) == 3


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b[:40] + bytes(8) + b[48:], lambda b: b""])
def test_a_damaged_program_is_compiled_anew(folder, damage):
    x, options = np.arange(5.0), unknown()
    first = made(x, options)
    (file,) = folder.iterdir()
    file.write_bytes(damage(file.read_bytes()))
    np.testing.assert_array_equal(made(x, options), first)
    assert announced
    made(x, options)
    assert announced == []


def test_a_program_of_jax_s_own_cache_is_not_written_again_which_would_break_it(folder):
    x, options = np.arange(7.0), unknown()
    programs.keep(None)
    first = made(x, options=options)
    programs.keep(folder)
    for _ in range(2):
        jax.clear_caches()
        np.testing.assert_array_equal(made(x, options=options), first)
        assert list(folder.iterdir()) == []


def test_a_program_of_the_folder_is_not_in_jax_s_own_cache_as_well(folder):
    x, options = np.arange(7.0), unknown()
    for _ in range(2):
        jax.clear_caches()
        made(x, options=options)
        (file,) = folder.iterdir()  # compiled and written, the second time too
        file.unlink()
    assert jax.config.jax_persistent_cache_min_compile_time_secs == 0.0


def test_other_threads_keep_their_programs_in_jax_s_own_cache_meanwhile(folder):
    seen = []
    with programs._unshared():
        other = threading.Thread(target=lambda: seen.append(jax.config.jax_persistent_cache_min_compile_time_secs))
        other.start()
        other.join()
        seen.append(jax.config.jax_persistent_cache_min_compile_time_secs)
    assert seen == [0.0, np.inf]


def looped(x: Any, *, gain: float) -> Any:
    """Operations before and behind a loop, and a pair of results of which one is an argument."""
    level = jnp.cumsum(jnp.where(x > 0.0, gain * x, 0.0))
    last, path = lax.scan(lambda c, v: (0.5 * c + v, c), 0.0 * x[0], level)
    return {"path": jnp.sqrt(path + 1.0), "pair": (last, x)}


def test_a_short_recording_is_steps_and_a_long_one_one_program_with_the_same_results(folder):
    x = np.sin(np.arange(300.0))
    padded = np.concatenate([x, np.zeros(programs.BUCKET + 1 - 300)])
    short, long = (programs.Program(looped)(v, gain=2.0) for v in (x, padded))
    assert isinstance(short["path"], np.ndarray) and isinstance(long["path"], jax.Array)
    np.testing.assert_allclose(short["path"], long["path"][:300], rtol=1e-13)
    want = jax.jit(looped, static_argnames="gain")(x, gain=2.0)
    again = programs.Program(looped)(x, gain=2.0)  # from the folder
    for found in (short, again):
        assert jax.tree.structure(found) == jax.tree.structure(want)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-13), found, want)


def test_steps_compute_in_the_float_type_of_jax():
    with jax.enable_x64(False):
        found = programs.Program(looped)(np.arange(4.0), gain=2.0)
    assert found["path"].dtype == np.float32
    np.testing.assert_allclose(found["path"], programs.Program(looped)(np.arange(4.0), gain=2.0)["path"], rtol=1e-6)


def test_a_loop_that_stands_twice_in_a_function_is_compiled_once():
    compiled = []

    def compile(function: Any, shapes: Any) -> Any:
        compiled.append(shapes)
        return jax.jit(function).lower(*shapes).compile()

    inner = jax.jit(lambda x: lax.scan(lambda c, v: (c + v, c), 0.0, x)[1])
    found = staged(lambda x: inner(x) + inner(2.0 * x), (np.ones(3),), compile)(np.ones(3))
    assert len(compiled) == 1
    np.testing.assert_allclose(found, [0.0, 3.0, 6.0])


@pytest.mark.parametrize("reverse", [False, True])
def test_turns_of_a_short_loop_share_the_programs_of_its_loops(reverse):
    compiled = []

    def compile(function: Any, shapes: Any) -> Any:
        compiled.append(shapes)
        return jax.jit(function).lower(*shapes).compile()

    def side(total: Any, values: Any) -> tuple[Any, Any]:
        start = jnp.zeros(2)  # an array of one number: the program makes it, it is no argument
        last, path = lax.scan(lambda c, v: (c + v, c[0]), start, values)
        return total * 2.0 + last[0], path + total

    def function(x: Any) -> Any:
        return lax.scan(side, 1.0, x, reverse=reverse)

    x = np.arange(10.0).reshape(2, 5)
    found = staged(function, (x,), compile)(x)
    assert [[shape.shape for shape in shapes] for shapes in compiled] == [[(5,)]]
    for got, want in zip(found, jax.jit(function)(x), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-14)


def test_a_plan_has_no_step_twice_and_none_of_constants():
    def function(x: Any) -> Any:
        rate = jnp.sin(jnp.float64(2.0)) * jnp.arange(3.0)
        return jnp.sin(x) * rate + jnp.sin(x), jnp.sin(jnp.float64(2.0)) * jnp.ones(3)

    plan = staged(function, (np.ones(3),), lambda *_: pytest.fail("nothing to compile"))
    assert [step.name for step in plan.plan.steps] == ["sin", "mul", "add"]
    for found, want in zip(plan(np.full(3, 0.3)), jax.jit(function)(np.full(3, 0.3)), strict=True):
        np.testing.assert_allclose(found, want, rtol=1e-14)


def test_a_folder_that_cannot_be_written_costs_nothing_but_the_keeping(folder):
    programs.keep(folder / "absent")
    np.testing.assert_array_equal(made(np.ones(2)), 2.0 * np.pi * np.ones(2))


def test_the_folder_loses_what_was_not_used_for_longest(folder):
    for number in range(4):
        (folder / str(number)).write_bytes(bytes(10))
    for number, second in enumerate((3, 1, 4, 2)):
        programs.os.utime(folder / str(number), (second, second))
    programs.shortened(folder, 25)
    assert sorted(path.name for path in folder.iterdir()) == ["0", "2"]
