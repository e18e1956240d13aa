"""Readings of three people, and the likelihood of a length and a noise; processes that share a fit import them."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jgait.params import fixed, per_subject, positive


class Leg(NamedTuple):
    length: Any
    noise: Any
    offset: Any


def likelihood(p, item):
    """Minus the log-likelihood of readings (m,) of `length + offset` with variance `noise`, over m."""
    error = item - p.length - p.offset
    return 0.5 * jnp.mean(error**2 / p.noise + jnp.log(p.noise))


PEOPLE = ["ann", "bob", "ann", "cy", "bob", "cy"]
TRUE = {"ann": 0.4, "bob": 0.45, "cy": 0.5}
READINGS = np.random.default_rng(0).normal(0.0, 0.1, (6, 40)) + np.array([TRUE[name] for name in PEOPLE])[:, None]
OWN = Leg(per_subject(positive), positive, fixed)
START = Leg(0.3, 1.0, 0.0)
