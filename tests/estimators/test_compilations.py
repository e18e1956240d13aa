"""Programs are kept between processes."""

import threading
from typing import Any

import jax
import numpy as np
import pytest
from jax import lax

from jgait.estimators import programs

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
