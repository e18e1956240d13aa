"""What moves a number: effects equal those of planted errors."""

import math

import jax
import numpy as np
import pytest

from jgait import estimators, simulate
from jgait.estimators.labels import LABELS, words
from jgait.estimators.stride_flags import in_order, regular
from jgait.params import stated
from jgait.simulate import sensors
from jgait.tune import explain
from jgait.tune.explain import CALIBRATION, with_error

WAIST = estimators.get("waist")
SENSOR = sensors.MPU6000


@pytest.fixture(scope="module")
def walk():
    sensor, worn = SENSOR._replace(packet_loss=0.0), ("waist", "thigh_left")
    recording, _ = simulate.recording(jax.random.key(3), None, simulate.straight(15.0), sensor, placements=worn)
    return recording


@pytest.fixture(scope="module")
def explained(walk):
    return explain(WAIST, WAIST.params, walk, person={"height": 1.75})


def length(params, walk):
    estimate = WAIST.estimate(params, walk)
    return float(np.mean(estimate.strides.length[in_order(estimate)[regular(estimate, WAIST.about.flags)]]))


def slope(number, step):
    return (number(step) - number(-step)) / (2.0 * step)


def test_the_effect_of_a_parameter_is_that_of_finite_differences(walk, explained):
    rows = {a.name: a for a in explained.assumptions}
    assert math.isclose(explained.value, length(WAIST.params, walk), rel_tol=1e-9)
    for name in ("pendulum_length", "pendulum_constant", "start_speed"):
        value, step = getattr(WAIST.params, name), 1e-4
        moved = slope(lambda d, n=name, v=value: length(WAIST.params._replace(**{n: v + d}), walk), step)
        assert rows[name].effect == pytest.approx(moved * stated(WAIST.params)[name].deviation, rel=1e-3)
        assert rows[name].tenth == pytest.approx(0.1 * value * moved, rel=1e-3)


@pytest.mark.parametrize("error", CALIBRATION)
def test_the_effect_of_a_sensor_is_that_of_finite_differences(walk, explained, error):
    row = next((a for a in explained.assumptions if a.name == f"{CALIBRATION[error][0]}, waist"), None)
    each = getattr(SENSOR, error) / (math.sqrt(3.0) if error == "mounting" else 1.0)
    axes = [
        slope(lambda d, a=axis: length(WAIST.params, with_error(walk, "waist", error, d * a)), 1e-3)
        for axis in each * np.eye(3)
    ]
    assert (0.0 if row is None else row.effect) == pytest.approx(
        math.hypot(*axes), rel=0.02, abs=2e-3 * explained.stddev
    )


def test_the_ranking_adds_up_and_names_what_is_not_stated(explained):
    known = [a for a in explained.assumptions if not math.isnan(a.deviation)]
    assert explained.stddev == pytest.approx(math.hypot(*(a.effect for a in known)))
    assert sum(a.share for a in known) == pytest.approx(1.0)
    assert [a.share for a in known] == sorted((a.share for a in known), reverse=True)
    assert not any("thigh" in a.name for a in explained.assumptions)
    assert {a.name for a in explained.unstated} >= {"excursion_power"}
    assert all(a.without <= explained.stddev for a in known)
    assert explained.sentence.startswith(f"stride length {explained.value:.3f} ± ")
    assert len(explained.to_dataframe()) == len(explained.assumptions)


def test_a_measured_person_and_given_deviations_replace_those_declared(walk):
    explained = explain(WAIST, WAIST.params, walk, deviations={"excursion_power": 0.1, "pendulum_constant": 0.0})
    rows = {a.name: a for a in explained.assumptions}
    assert rows["excursion_power"].effect == pytest.approx(0.1 * rows["excursion_power"].tenth / 0.06)
    assert "pendulum_constant" not in rows
    with pytest.raises(ValueError, match="no parameter 'leg'"):
        explain(WAIST, WAIST.params, walk, deviations={"leg": 1.0})
    with pytest.raises(ValueError, match="no 'stride_duration' with a gradient"):
        explain(WAIST, WAIST.params, walk, "stride_duration")


def test_every_parameter_has_words_for_readers():
    every = {name for one in estimators.names() for name in stated(estimators.get(one).params)}
    assert [name for name in every if words(name) in (name, name.replace("_", " ")) and name not in LABELS] == []
    assert words("pendulum_length_sd") == "height of the sensor above ground, uncertainty"
