"""Two values have one text if they compute the same, in this process and in the next."""

import dataclasses
import functools
import subprocess
import sys
from collections.abc import Callable

import jax
import numpy as np
import pytest

from jgait.estimators import leg_ekf
from jgait.tune.identity import described


def helper(x):
    return 3.0 * x


def edited(name, text, **variables):
    """The function that a file or notebook of that text defines."""
    space = {"__name__": "__main__", **variables}
    exec(text, space)
    return space[name]


def scaled(factor):
    def inner(p, x):
        return factor * (p - x)

    return inner


class Scaled:
    def __init__(self, factor):
        self.factor = factor

    def __call__(self, p, x):
        return self.factor * (p - x)

    def loss(self, p, x):
        return self(p, x)


@dataclasses.dataclass(frozen=True)
class Terms:
    terms: tuple[Callable[..., float], ...]


def wrapping(function, factor):
    @functools.wraps(function)
    def outer(p, x):
        return factor * function(p, x)

    return outer


DEF = "def loss(p, x):\n    return {}\n"
DIFFERENT = {
    "lambdas": (lambda p, x: p - x, lambda p, x: p - 10 * x),
    "constants": (lambda p, x: p - 2 * x, lambda p, x: p - 3 * x),
    "types of constants": (lambda p, x: p - 2 * x, lambda p, x: p - 2.0 * x),
    "order": (lambda p, x: p - x, lambda p, x: x - p),
    "constants inside": (lambda p, x: (lambda y: y * 2)(p - x), lambda p, x: (lambda y: y * 3)(p - x)),
    "defaults": (lambda p, x, w=1.0: w * p, lambda p, x, w=2.0: w * p),
    "defaults of keywords": (lambda p, *, w=1.0: w * p, lambda p, *, w=2.0: w * p),
    "closures": (scaled(1.0), scaled(2.0)),
    "arrays in closures": (scaled(np.ones(3)), scaled(np.zeros(3))),
    "functions in closures": (scaled(lambda x: x + 1), scaled(lambda x: x + 2)),
    "partial": (functools.partial(helper, x=1.0), functools.partial(helper, x=2.0)),
    "partial of lambdas": (functools.partial(lambda p, x: p), functools.partial(lambda p, x: x)),
    "wrapped": (wrapping(helper, 1.0), wrapping(helper, 2.0)),
    "compiled": (jax.jit(lambda x: x + 1), jax.jit(lambda x: x + 2)),
    "objects": (Scaled(1.0), Scaled(2.0)),
    "methods": (Scaled(1.0).loss, Scaled(2.0).loss),
    "dataclasses": (Terms((lambda x: x + 1,)), Terms((lambda x: x + 2,))),
    "an edited def": (edited("loss", DEF.format("p - x")), edited("loss", DEF.format("p - 2 * x"))),
    "a variable of the module": (
        edited("loss", DEF.format("W * x"), W=1.0),
        edited("loss", DEF.format("W * x"), W=2.0),
    ),
    "an edited helper": (
        edited("loss", "def g(x):\n    return x\n" + DEF.format("g(x)")),
        edited("loss", "def g(x):\n    return 2 * x\n" + DEF.format("g(x)")),
    ),
}


@pytest.mark.parametrize("what", DIFFERENT)
def test_what_computes_otherwise_has_another_text(what):
    one, other = DIFFERENT[what]
    assert described(one) != described(other)


def test_what_computes_the_same_has_one_text():
    assert described(scaled(2.0)) == described(scaled(2.0))
    text = DEF.format("p.y - x")
    assert described(edited("loss", text)) == described(edited("loss", f"\n# a comment\n{text}", y=3.0))
    counter = {"calls": 0}
    before = described(scaled(counter))
    counter["calls"] += 1
    assert described(scaled(counter)) == before
    again = edited("loss", "def loss(p, x):\n    return g(x)\ndef g(x):\n    return loss(x, x)\n")
    assert described(again) == described(again)


def test_a_text_is_the_same_in_another_process():
    code = "import jax\nfrom jgait.estimators import leg_ekf\nfrom jgait.tune.identity import described\n"
    code += "f = lambda x: (x in {'a', 'b', 'c', 'd'}, jax.numpy.sum(x))\n"
    code += "print(described((f, leg_ekf.estimator().run, leg_ekf.estimator().prepare, f.__class__)))"
    runs = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True) for _ in "ab"]
    texts = {one.stdout for one in runs}
    assert len(texts) == 1 and " at 0x" not in texts.pop()


def test_descriptions_tell_apart_what_gives_other_results():
    default, paper = leg_ekf.estimator(), leg_ekf.estimator(leg_ekf.PAPER)
    assert described(default.prepare) == described(leg_ekf.estimator().prepare)
    assert described(default.prepare) != described(paper.prepare)
    assert "rate_hz=50.0" in described(paper.prepare)
    assert described(np.arange(3.0)) != described(np.arange(1.0, 4.0))
    assert " at 0x" not in described({"a": object(), "b": (object(),)})


def test_lambdas_of_the_package_itself_are_told_apart():
    made = [lambda x: x + 1.0, lambda x: x + 2.0]
    for one in made:
        one.__module__, one.__qualname__ = "jgait.evaluate", "<lambda>"
    assert described(made[0]) != described(made[1])
