"""The model of doubt: what more evidence does, and the numbers that are shipped."""

import jax.numpy as jnp
import numpy as np
import pytest

from jgait import estimators
from jgait.quality import EVIDENCE, QualityParams, doubt, factor, learned
from jgait.quality.model import widened, with_doubt
from jgait.types import Estimate, Legs, Strides

DRAWN = np.random.default_rng(5)
PARAMS = QualityParams(
    0.1, DRAWN.uniform(0.0, 1.0, len(EVIDENCE)), -3.0, DRAWN.uniform(0.0, 2.0, len(EVIDENCE)), 7.0, within95=2.1
)
"""Numbers with every weight above 0."""


def evidence(rows: int, largest: float = 1.0) -> dict[str, np.ndarray]:
    return {name: DRAWN.uniform(0.0, largest, rows) for name in EVIDENCE}


@pytest.mark.parametrize("name", EVIDENCE)
def test_more_evidence_means_more_doubt_and_larger_deviations(name):
    less = evidence(20)
    more = {**less, name: less[name] + 0.5}
    assert np.all(doubt(PARAMS, more) > doubt(PARAMS, less)) and np.all(
        factor(PARAMS, more, 0.02, 1.2) > factor(PARAMS, less, 0.02, 1.2)
    )


def test_evidence_that_is_absent_counts_as_zero_and_arrays_of_jax_give_the_same():
    found = evidence(4)
    part = {name: values for name, values in found.items() if name != "rise"}
    np.testing.assert_allclose(doubt(PARAMS, part), doubt(PARAMS, {**found, "rise": np.zeros(4)}))
    traced = {name: jnp.asarray(values) for name, values in found.items()}
    np.testing.assert_allclose(doubt(PARAMS, traced), doubt(PARAMS, found), rtol=1e-5)


@pytest.mark.parametrize("name", ["foot_ins", "ankle_stride", "waist"])
def test_the_shipped_numbers_never_make_a_method_more_certain_than_it_says(name):
    p = learned(name)
    assert estimators.get(name).name == name
    assert float(factor(p, {"innovation": np.zeros(1)}, 0.02, 1.2)[0]) >= 1.0
    assert np.all(np.asarray(p.spread) >= 0.0) and np.all(np.asarray(p.wrong) >= 0.0) and p.tail > 1.0
    assert 1.0 < p.within95 < 3.5
    assert float(doubt(p, {"innovation": np.zeros(1)})[0]) < 0.1
    assert np.any(np.asarray(p.wrong) > 0.0) == (name != "waist")


def estimate(rows: int = 3) -> Estimate:
    """Strides of 1 m of the right foot, one a second, each known to 2 cm."""
    time, one = np.arange(rows + 1.0), np.ones(rows)
    strides = Strides(
        np.zeros(rows, int), time[:-1], None, time[1:], one, None, None, np.ones(rows, bool), speed=one
    )  # fmt: skip
    spread = strides._replace(length=0.02 * one, speed=0.02 * one)
    return Estimate(
        time, Legs(None, None), None, time, np.ones(rows + 1, bool), {"distance_stddev": 0.02 * time}, strides,
        strides_stddev=spread,
    )  # fmt: skip


def test_the_factor_widens_strides_and_the_distance_along_them():
    found = {"innovation": np.array([0.0, 0.0, 2.0])}
    judged = with_doubt(estimate(), PARAMS, found)
    times = factor(PARAMS, found, 0.02 * np.ones(3), np.ones(3))
    np.testing.assert_allclose(judged.strides_stddev.length, 0.02 * times)
    np.testing.assert_allclose(judged.strides_stddev.speed, 0.02 * times)
    np.testing.assert_allclose(judged.diagnostics["distance_stddev"][-1], 0.02 * np.sum(times))
    np.testing.assert_array_equal(judged.diagnostics["doubtful"], doubt(PARAMS, found) > 0.1)
    assert judged.diagnostics["quality"].interval.tolist() == [2.1] * 3


def test_a_further_error_of_all_strides_adds_up_in_the_distance():
    wide = widened(estimate(), np.full(3, 0.1))
    np.testing.assert_allclose(wide.strides_stddev.length, np.hypot(0.02, 0.1))
    np.testing.assert_allclose(wide.diagnostics["distance_stddev"][-1], np.hypot(0.06, 0.3))


def test_an_error_of_a_sensor_adds_the_same_share_to_all_lengths():
    length, stated = np.array([0.5, 1.0, 2.0]), np.array([0.01, 0.02, 0.005])
    plain = QualityParams(rates=2.0, spread=np.zeros(len(EVIDENCE)))
    wide = factor(plain, {"rates": np.full(3, 0.1)}, stated, length) * stated
    np.testing.assert_allclose(wide, np.hypot(stated, 0.2 * length))
