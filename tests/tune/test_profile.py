"""A profile is the loss with all else fitted again, and its interval ends where the loss has risen enough."""

import jax.numpy as jnp
import numpy as np
import optax
import pytest
from made.models import Gauss, Line, Z, close, gauss, straight

from jgait.params import fixed, positive, real
from jgait.tune.profile import profile


def test_the_profile_of_a_parabola_is_its_closed_form():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(40, 3)) * [1.0, 2.0, 0.1] + [0.0, 0.0, 1.0]
    y = x @ [1.0, -2.0, 3.0] + rng.normal(0.0, 0.5, 40)
    best = Line(jnp.asarray(np.linalg.lstsq(x, y)[0]), 0.5)
    covariance = np.linalg.inv(x.T @ x) * 0.5**2
    middle, stderr = float(best.coefficients[1]), np.sqrt(covariance[1, 1])
    values = middle + stderr * np.array([3.1, -3.3, -1.2, 0.4, 1.7])  # in any order, and not on the minimum
    found = profile(
        straight, best, Line(real, fixed), (x, y), "coefficients[1]", values, optax.sgd(0.15, momentum=0.6), steps=150
    )
    lowest = sum(float(straight(best, item)) for item in zip(x, y, strict=True))
    close(found.values, np.sort(values))
    close(found.losses, lowest + 0.5 * ((found.values - middle) / stderr) ** 2, rtol=1e-9)
    close(found.rises, found.losses - lowest, rtol=1e-6, atol=1e-7)
    close(found.interval(), [middle - Z * stderr, middle + Z * stderr], rtol=1e-7)
    others = best.coefficients[0] + covariance[0, 1] / covariance[1, 1] * (found.values - middle)
    close(found.params.coefficients[:, 0], others, atol=1e-6)
    close(found.params.coefficients[:, 1], found.values)
    assert found.params.scale is best.scale
    assert np.all(found.gradient_norms < 1e-4)


def test_a_profile_through_a_transform_has_its_ends_in_natural_units():
    def loss(params, item):
        return 0.5 * (jnp.log(params.scale) - item) ** 2

    data = np.array([0.1, 0.5])
    found = profile(
        loss, Gauss(0.0, 1.0), Gauss(fixed, positive), data, "scale", np.geomspace(0.1, 30.0, 8), optax.sgd(0.1)
    )
    close(found.interval(), np.exp(0.3 + np.array([-Z, Z]) / np.sqrt(2.0)))
    close(found.interval(0.6826894921370859), np.exp(0.3 + np.array([-1.0, 1.0]) / np.sqrt(2.0)))
    close(found.rises, (np.log(found.values) - 0.3) ** 2)


def test_steps_into_the_void_are_taken_back_and_values_in_the_void_are_outside_the_interval():
    def loss(params, item):  # not a number where mean or scale are above 1.5
        bad = (params.mean > 1.5) | (params.scale > 1.5)
        return item * jnp.where(bad, jnp.nan, (params.mean - 1.4) ** 2 + (params.scale - 1.0) ** 2)

    found = profile(loss, Gauss(0.0, 1.0), Gauss(real, positive), np.full(1, 9.0), "scale",
                    [0.2, 0.7, 1.0, 1.3, 2.0], optax.sgd(0.1), steps=60)  # fmt: skip
    assert list(np.isfinite(found.losses)) == [True, True, True, True, False]
    close(found.losses[:4], 9.0 * np.array([0.64, 0.09, 0.0, 0.09]), atol=1e-6)
    close(found.params.mean[:4], np.full(4, 1.4), atol=1e-4)
    low, high = found.interval()
    assert 0.2 < low < 0.7 and high == pytest.approx(1.3)  # the last value that has a loss


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "mode"}, "name must be one of the free numbers mean, scale; got 'mode'"),
        ({"values": [1.0, -1.0]}, r"values of 'scale' must lie in \(0, inf\)"),
        ({"values": [1.0]}, "two different numbers"),
        ({"steps": 0}, "steps must be at least 1; got 0"),
        ({"loss": lambda p, y: p.mean * jnp.nan}, "not finite at any of the values of 'scale'"),
    ],
)
def test_misuse_of_a_profile_is_refused_by_name(change, message):
    call = {
        "loss": gauss, "params": Gauss(0.0, 1.0), "transforms": Gauss(real, positive), "data": np.ones(3),
        "name": "scale", "values": [1.0, 2.0], "optimizer": optax.sgd(0.1), "steps": 2,
    }  # fmt: skip
    with pytest.raises(ValueError, match=message):
        profile(**(call | change))
