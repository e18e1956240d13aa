"""Models and recordings for the tests of filters: two states, two observations; linear, bent, and on a manifold."""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jgait import filtering
from jgait.estimators.leg_ekf import inclination
from jgait.estimators.leg_ekf import model as leg_model
from jgait.filtering import EKF, FIELDS, Belief, Covariance, Model

SAMPLES = 12
ONCE = EKF()
P = jnp.asarray([0.3, 0.2, 0.1, 0.05])
"""Process noise, variance of the readings, a parameter of the transition, a parameter of the observation."""


class Cart(NamedTuple):
    """Position and speed; also their errors."""

    position: Any
    speed: Any


class Fault(NamedTuple):
    """What makes the functions of `BROKEN` fail where it is large."""

    transition: Any
    observation: Any
    noise: Any


class Push(NamedTuple):
    """Acceleration over the interval, and faults."""

    acceleration: Any
    fault: Any


class Reading(NamedTuple):
    """Two readings that share noise."""

    near: Any
    far: Any


def cart_initial(p: Any) -> Belief:
    return Belief(Cart(0.5, -0.2), Covariance.from_variances(Cart(2.0, 1.0)).with_entries({("speed", "position"): 0.3}))


def cart_transition(p: Any, s: Cart, u: Push, dt: Any) -> Cart:
    return Cart(s.position + dt * s.speed, (1.0 - p[2] * dt) * s.speed + dt * u.acceleration)


def cart_noise(p: Any, s: Cart, u: Push, dt: Any) -> Covariance:
    variances = Cart(p[0] * dt**3 / 3.0, p[0] * dt)
    return Covariance.from_variances(variances).with_entries({("position", "speed"): p[0] * dt**2 / 2.0})


def cart_observation(p: Any, s: Cart, u: Push) -> Reading:
    return Reading(s.position, 2.0 * s.position + (1.0 + p[3]) * s.speed + 0.1 * u.acceleration)


def cart_reading_noise(p: Any, s: Cart, u: Push) -> Covariance:
    return Covariance.from_variances(Reading(p[1], 2.0 * p[1])).with_entries({("near", "far"): 0.3 * p[1]})


CART = Model(cart_initial, cart_transition, cart_noise, cart_observation, cart_reading_noise)


def bent_transition(p: Any, s: Cart, u: Push, dt: Any) -> Cart:
    return Cart(s.position + dt * s.speed, s.speed - dt * jnp.sin(s.position) * (1.0 + p[2]) + dt * u.acceleration)


def bent_observation(p: Any, s: Cart, u: Push) -> Reading:
    return Reading(jnp.sin(s.position), jnp.exp(0.3 * s.speed + p[3]))


BENT = Model(cart_initial, bent_transition, cart_noise, bent_observation, cart_reading_noise)
"""No constant in the observation's Jacobian."""


def broken_transition(p: Any, s: Cart, u: Push, dt: Any) -> Cart:
    after = bent_transition(p, s, u, dt)
    return after._replace(speed=after.speed * jnp.exp(u.fault.transition))


def broken_observation(p: Any, s: Cart, u: Push) -> Reading:
    shown = bent_observation(p, s, u)
    return shown._replace(near=shown.near * jnp.exp(u.fault.observation))


def broken_noise(p: Any, s: Cart, u: Push) -> Covariance:
    variances = Reading(p[1] * (1.0 - u.fault.noise), 2.0 * p[1])
    return Covariance.from_variances(variances).with_entries({("near", "far"): 0.3 * p[1]})


BROKEN = BENT._replace(transition=broken_transition, observation=broken_observation, observation_noise=broken_noise)
"""`BENT` with functions that overflow where their fault is large, and a variance that is negative there."""


class Heading(NamedTuple):
    """A direction as a unit vector, and its rate."""

    east: Any
    north: Any
    rate: Any


class Turn(NamedTuple):
    """Errors of a heading, on a chart that bends: the error of the rate depends on the origin."""

    angle: Any
    rate: Any


def heading_retract(s: Heading, e: Turn) -> Heading:
    c, d = jnp.cos(e.angle), jnp.sin(e.angle)
    return Heading(c * s.east - d * s.north, d * s.east + c * s.north, s.rate + e.rate + 0.5 * e.angle**2)


def heading_local(r: Heading, s: Heading) -> Turn:
    angle = jnp.arctan2(r.east * s.north - r.north * s.east, r.east * s.east + r.north * s.north)
    return Turn(angle, s.rate - r.rate - 0.5 * angle**2)


def heading_transition(p: Any, s: Heading, u: Push, dt: Any) -> Heading:
    c, d = jnp.cos(dt * s.rate), jnp.sin(dt * s.rate)
    rate = (1.0 - p[2] * dt) * s.rate + dt * u.acceleration
    return Heading(c * s.east - d * s.north, d * s.east + c * s.north, rate)


def heading_residual(a: Reading, b: Reading) -> Reading:
    turn = a.near - b.near
    return Reading(jnp.arctan2(jnp.sin(turn), jnp.cos(turn)), a.far - b.far)


HEADING = Model(
    lambda p: Belief(Heading(1.0, 0.0, 0.3), Covariance.from_variances(Turn(0.5, 0.2))),
    heading_transition,
    lambda p, s, u, dt: Turn(0.1 * p[0] * dt, p[0] * dt),
    lambda p, s, u: Reading(jnp.arctan2(s.north, s.east), (1.0 + p[3]) * s.rate),
    cart_reading_noise,
    heading_retract,
    heading_local,
    heading_residual,
)


class Place(NamedTuple):
    """Where on a line."""

    s: Any


class Offset(NamedTuple):
    """Error e of a place: s ⊕ e = s + sinh e, a chart that stretches away from its origin."""

    e: Any


LINE = Model(
    lambda p: Belief(Place(jnp.zeros_like(p)), Covariance.from_variances(Offset(p))),
    lambda p, s, u, dt: s,
    lambda p, s, u, dt: Offset(0.5 * dt),
    lambda p, s, u: s,
    lambda p, s, u: Place(1.0),
    lambda state, error: Place(state.s + jnp.sinh(error.e)),
    lambda reference, state: Offset(jnp.arcsinh(state.s - reference.s)),
)
"""One state and one observation on a manifold; the parameter is the first variance."""


class Case(NamedTuple):
    """A model and a recording."""

    model: Model
    params: Any
    observations: Any
    controls: Any
    dt: Any
    mask: Any


MODELS = {"cart": CART, "bent": BENT, "heading": HEADING}


def case(name: str, samples: int = SAMPLES, masked: bool = True) -> Case:
    """A random recording of a model by name; with a mask, also steps of unequal length."""
    rng = np.random.default_rng(samples)

    def series(scale: float = 0.5) -> Any:
        return scale * rng.normal(size=samples)

    def mask(like: Any) -> Any:
        return jax.tree.map(lambda leaf: rng.random(samples) > 0.3, like) if masked else None

    dt = rng.uniform(0.05, 0.3, samples) if masked else 0.1
    here = np.ones(samples, bool)
    if name in MODELS:
        seen = Reading(series(), series())
        arrays = seen, Push(series(), Fault(*(np.zeros(samples),) * 3)), dt, mask(seen)
        return Case(MODELS[name], P, *on_device(arrays))
    if name == "line":
        seen = Place(series())
        arrays = seen, Push(series(), Fault(*(np.zeros(samples),) * 3)), dt, mask(seen)
        return Case(LINE, jnp.asarray(3.0), *on_device(arrays))
    if name == "inclination":
        up = np.stack([series(0.1), series(0.1), 1.0 + series(0.1)], axis=1)
        seen = inclination.InclinationObservation(up, np.stack([series(0.1) for _ in range(3)], axis=1))
        still = rng.random(samples) > 0.5
        rate = np.stack([series() for _ in range(3)], axis=1)
        arrays = seen, inclination.InclinationControl(rate, still, here), 0.2 * dt, mask(seen)
        return Case(inclination.MODEL, inclination.InclinationNoise(), *on_device(arrays))
    params = leg_model.LegModelParams(0.4, 0.41, 1e-6, 1.0, 1e-8, 1e-3, 2e-3, 1e-4)
    seen = leg_model.LegObservation(*(series(0.3) for _ in range(6)))
    controls = leg_model.LegControl(np.full(samples, 0.01), np.full(samples, 0.02))
    if name == "rates":  # as `leg_ekf.PAPER` runs it: gyroscopes alone
        there = leg_model.LegObservation(here, here, *(~here,) * 4)
        return Case(leg_model.MODEL, params, *on_device((seen, controls, 0.02, there)))
    return Case(leg_model.MODEL, params, *on_device((seen, controls, 0.2 * dt, mask(seen))))


MORE = 20
"""Samples of padding."""


def padded(c: Case) -> Case:
    """The recording with samples in which no time passes and nothing is measured."""

    def longer(leaf: Any, value: float) -> Any:
        return np.concatenate([leaf, np.full(MORE, value, leaf.dtype)])

    return c._replace(
        observations=jax.tree.map(lambda v: longer(v, 1.0), c.observations),
        controls=jax.tree.map(lambda v: longer(v, 0.5), c.controls), dt=longer(c.dt, 0.0),
        mask=jax.tree.map(lambda v: longer(v, 0.0), c.mask),
    )  # fmt: skip


def on_device(tree: Any) -> Any:
    """Arrays as JAX's own, which costs no program; numbers stay."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf) if isinstance(leaf, np.ndarray) else leaf, tree)


@functools.cache
def _program(function: Any, model: Model, settings: tuple[tuple[str, Any], ...]) -> Any:
    """A compiled filter or smoother of a model; cases of one length share it."""

    def run(params: Any, observations: Any, arrays: dict[str, Any]) -> Any:
        return function(model, params, observations, **arrays, **dict(settings))

    return jax.jit(run)


def _solved(function: Any, c: Case, initial: Any, **settings: Any) -> Any:
    arrays = {"controls": c.controls, "dt": c.dt, "mask": c.mask, "initial": initial}
    leaves = jax.tree.leaves((c.params, c.observations, arrays))
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in leaves)
    # Where all of a mask is known beforehand, the filter leaves out what it never sees; a compiled one cannot know.
    known = c.mask is not None and not traced and all(np.all(leaf) or not np.any(leaf) for leaf in c.mask)
    if traced or known:
        return function(c.model, c.params, c.observations, **arrays, **settings)
    return _program(function, c.model, tuple(sorted(settings.items())))(c.params, c.observations, arrays)


def filtered(
    c: Case, execution: str = "core", method: Any = ONCE, keep: Any = FIELDS, initial: Any = None,
) -> Any:  # fmt: skip
    return _solved(filtering.kalman_filter, c, initial, execution=execution, method=method, keep=keep)


def smoothed(
    c: Case, execution: str = "core", method: Any = ONCE, keep: Any = ("log_likelihood",), initial: Any = None,
    covariance: Any = True,
) -> Any:  # fmt: skip
    return _solved(
        filtering.kalman_smoother, c, initial, execution=execution, method=method, keep=keep, covariance=covariance,
    )  # fmt: skip


def same(ours: Any, theirs: Any, tolerance: float = 1e-9) -> None:
    """All numbers of two results agree, relative to their size or to 1."""
    assert jax.tree.structure(ours) == jax.tree.structure(theirs)
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_allclose(np.asarray(a), np.asarray(b), rtol=tolerance, atol=tolerance)
