"""Programs are kept between processes."""

import hashlib
import sys
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jgait.estimators import programs
from jgait.filtering import Covariance

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


class Pair(NamedTuple):
    """A result of a type of its own."""

    doubled: Any
    same: Any


def paired(x: Any) -> dict[str, Any]:
    cov = Covariance.from_dense(jnp.diag(x[:4])[None], Pair(x[0], Pair(x[1], x[2:4])))
    return {"pair": Pair(2.0 * x, x), "cov": cov, "sparse": Covariance.from_variances(Pair(x[0], None))}


def test_results_keep_their_types(folder):
    x = np.arange(7.0)
    for _ in range(2):  # made, then read
        found = programs.Program(paired)(x)
        assert isinstance(found["pair"], Pair)
        np.testing.assert_array_equal(found["pair"].doubled, 2.0 * x)
        np.testing.assert_array_equal(found["cov"].variances().same.same[0], x[2:4])
        assert found["sparse"].variances() == Pair(x[0], None)
    assert len(list(folder.iterdir())) == 1


def test_a_file_cannot_name_what_is_not_loaded(folder):
    """A file that names a class loads no module: it is not used."""
    x = np.arange(3.0)
    programs.Program(paired)(x)
    (file,) = folder.iterdir()
    content = file.read_bytes()[32:].replace(b'["', b'["absent_module:Thing", "', 1)
    file.write_bytes(hashlib.sha256(content).digest() + content)
    announced.clear()
    np.testing.assert_array_equal(programs.Program(paired)(x)["pair"].same, x)
    assert announced and "absent_module" not in sys.modules


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
