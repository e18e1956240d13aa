"""Noise models start at the constant that they replace; soft decisions tend to hard ones; their gradients are true."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made.foot import foot

from jgait import params
from jgait.estimators import foot_ins, noise
from jgait.estimators.foot_ins import FootOptions, FootParams
from jgait.estimators.foot_ins.estimator import velocity_variance
from jgait.estimators.noise import FEATURES, LogLinear, Network


@pytest.fixture(scope="module")
def recording():
    return foot(strides=3, roll=0.03, seed=1).recording


@pytest.fixture(scope="module")
def signals(recording):
    return foot_ins.prepared(recording).inputs.right


@pytest.mark.parametrize("name", noise.MODELS)
def test_every_model_starts_at_the_constant(name, signals):
    model = noise.model_of(name)
    assert not np.any(model.log_scale(jnp.asarray(signals.features)))
    assert sum(np.size(leaf) for leaf in jax.tree.leaves(model)) <= 500
    start = foot_ins.estimator(FootOptions(noise=name)).params
    np.testing.assert_array_equal(
        velocity_variance(start, signals, False), velocity_variance(FootParams(), signals, False)
    )
    declared = params.priors(start.noise)
    assert len(jax.tree.leaves(declared, is_leaf=lambda v: isinstance(v, params.Prior))) == len(model)


def test_weights_are_powers_of_the_features(signals):
    p = FootParams(noise=LogLinear(rate=2.0, stance=-1.0))
    column = {name: signals.features[:, FEATURES.index(name)] for name in ("rate", "stance")}
    expected = velocity_variance(FootParams(), signals, False) * np.exp(2.0 * column["rate"] - column["stance"])
    np.testing.assert_allclose(velocity_variance(p, signals, False), expected, rtol=1e-12)


def test_features_and_networks_use_no_later_sample(recording):
    imu = recording.sensors["foot_right"]
    jumps = tuple(np.abs(np.gradient(values[:, 0])) for values in (imu.gyr, imu.acc))
    flags = np.zeros(len(imu.time), bool)
    whole = noise.features(imu.gyr, imu.acc, jumps, flags, flags, 100.0)
    cut = 200
    begun = noise.features(*(v[:cut] for v in (imu.gyr, imu.acc)), tuple(v[:cut] for v in jumps), flags[:cut],
                           flags[:cut], 100.0)  # fmt: skip
    np.testing.assert_allclose(begun, whole[:cut], rtol=1e-9, atol=1e-9)
    assert whole.shape == (len(imu.time), len(FEATURES)) and np.isfinite(whole).all()
    p = Network()._replace(last=np.arange(8.0))
    np.testing.assert_allclose(p.log_scale(jnp.asarray(whole[:cut])), p.log_scale(jnp.asarray(whole))[:cut], rtol=1e-12)
    with pytest.raises(ValueError, match="needs an accelerometer"):
        noise.features(imu.gyr, None, jumps, flags, flags, 100.0)


def test_the_hard_decision_is_the_limit_of_the_soft_one(recording):
    signals = foot_ins.prepared(recording).inputs.right
    assert np.array_equal(signals.margin > 0.0, signals.stands)
    hard = velocity_variance(FootParams(), signals, False)
    soft = velocity_variance(FootParams(softness=1e-5), signals, True)
    np.testing.assert_allclose(soft[signals.stands], hard[signals.stands], rtol=1e-9)
    assert np.all(soft[~signals.stands] > 1e10 * hard[~signals.stands])
    wide = velocity_variance(FootParams(softness=0.5), signals, True)
    assert np.all(np.diff(np.asarray(wide / hard)[np.argsort(signals.margin)]) <= 1e-9)  # a smooth weight falls


@pytest.mark.release
def test_the_soft_estimate_tends_to_the_hard_one(recording):
    hard = foot_ins.estimate(FootParams(), recording)

    def apart(softness):
        soft = foot_ins.estimate(FootParams(softness=softness), recording, FootOptions(soft=True))
        return np.abs(soft.feet.right.position - hard.feet.right.position).max()

    assert apart(0.02) > 1e-4 > 1e-7 > apart(1e-6)


def test_gradients_reach_the_decision_and_the_weights(signals):
    """Of the variance of the zero velocity, by which alone they move a stride."""

    def variances(p):
        return jnp.log(velocity_variance(p, signals, True))

    both = jax.jit(lambda at, way: jax.jvp(variances, (at,), (way,)))
    usual = jax.tree.map(jnp.asarray, foot_ins.estimator(FootOptions(soft=True, noise="log_linear")).params)
    still = jax.tree.map(jnp.zeros_like, usual)
    for name in ("softness", "threshold_factor", "noise.rate", "noise.shake_long"):
        first, _, inner = name.partition(".")
        one = jnp.ones(())
        way = still._replace(**{first: getattr(still, first)._replace(**{inner: one}) if inner else one})
        up, down = (both(jax.tree.map(lambda v, w, s=s: v + s * w, usual, way), way)[0] for s in (1e-5, -1e-5))
        slope = both(usual, way)[1]
        np.testing.assert_allclose(slope, (up - down) / 2e-5, rtol=1e-4, atol=1e-7, err_msg=name)
        assert np.any(slope != 0.0), name
