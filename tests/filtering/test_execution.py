"""Every way to execute a filter gives what the dense one gives."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait import filtering
from jgait.estimators.leg_ekf import inclination
from jgait.estimators.leg_ekf import model as leg_model
from jgait.filtering import CKF, EKF, FIELDS, KF, UKF, Belief, Covariance, IteratedEKF, Model, fast
from jgait.filtering.components import known
from jgait.filtering.inputs import inputs
from jgait.filtering.tracing import Expansion
from jgait.geometry.vectors import Vector

SAMPLES = 30
ONE_UPDATE = EKF()


class Cart(NamedTuple):
    """Position and speed; also their errors."""

    position: Any
    speed: Any


class Push(NamedTuple):
    """Acceleration over the interval."""

    acceleration: Any


class Reading(NamedTuple):
    """Two readings that share noise."""

    near: Any
    far: Any


def cart_initial(p: Any) -> Belief:
    del p
    return Belief(Cart(0.5, -0.2), Covariance.from_variances(Cart(2.0, 1.0)).with_entries({("speed", "position"): 0.3}))


def cart_transition(p: Any, s: Cart, u: Push, dt: Any) -> Cart:
    return Cart(s.position + dt * s.speed, (1.0 - p[2] * dt) * s.speed + dt * u.acceleration)


def cart_noise(p: Any, s: Cart, u: Push, dt: Any) -> Covariance:
    del s, u
    variances = Cart(p[0] * dt**3 / 3.0, p[0] * dt)
    return Covariance.from_variances(variances).with_entries({("position", "speed"): p[0] * dt**2 / 2.0})


def cart_observation(p: Any, s: Cart, u: Push) -> Reading:
    del p
    return Reading(s.position, 2.0 * s.position + s.speed + 0.1 * u.acceleration)


def cart_reading_noise(p: Any, s: Cart, u: Push) -> Covariance:
    del s, u
    return Covariance.from_variances(Reading(p[1], 2.0 * p[1])).with_entries({("near", "far"): 0.3 * p[1]})


CART = Model(cart_initial, cart_transition, cart_noise, cart_observation, cart_reading_noise)


def bent_transition(p: Any, s: Cart, u: Push, dt: Any) -> Cart:
    return Cart(s.position + dt * s.speed, s.speed - dt * jnp.sin(s.position) * (1.0 + p[2]) + dt * u.acceleration)


def bent_observation(p: Any, s: Cart, u: Push) -> Reading:
    del p, u
    return Reading(jnp.sin(s.position), jnp.exp(0.3 * s.speed))


BENT = Model(cart_initial, bent_transition, cart_noise, bent_observation, cart_reading_noise)
"""No constant in the observation's Jacobian: the covariance is updated in Joseph's form."""


class Heading(NamedTuple):
    """A direction as a unit vector, and its rate."""

    east: Any
    north: Any
    rate: Any


class Turn(NamedTuple):
    """Errors of a heading [rad] and its rate [rad/s]."""

    angle: Any
    rate: Any


def heading_retract(s: Heading, e: Turn) -> Heading:
    c, d = jnp.cos(e.angle), jnp.sin(e.angle)
    return Heading(c * s.east - d * s.north, d * s.east + c * s.north, s.rate + e.rate)


def heading_local(r: Heading, s: Heading) -> Turn:
    return Turn(jnp.arctan2(r.east * s.north - r.north * s.east, r.east * s.east + r.north * s.north), s.rate - r.rate)


def heading_initial(p: Any) -> Belief:
    del p
    return Belief(Heading(1.0, 0.0, 0.3), Covariance.from_variances(Turn(0.5, 0.2)))


def heading_transition(p: Any, s: Heading, u: Any, dt: Any) -> Heading:
    del p, u
    return heading_retract(s, Turn(dt * s.rate, 0.0))


def heading_noise(p: Any, s: Heading, u: Any, dt: Any) -> Turn:
    del s, u
    return Turn(0.0 * p[0], p[0] * dt)


def heading_observation(p: Any, s: Heading, u: Any) -> Reading:
    del p, u
    return Reading(jnp.arctan2(s.north, s.east), s.rate)


def heading_residual(a: Reading, b: Reading) -> Reading:
    turn = a.near - b.near
    return Reading(jnp.arctan2(jnp.sin(turn), jnp.cos(turn)), a.far - b.far)


def heading_reading_noise(p: Any, s: Heading, u: Any) -> Reading:
    del s, u
    return Reading(p[1], 2.0 * p[1])


HEADING = Model(
    heading_initial, heading_transition, heading_noise, heading_observation, heading_reading_noise, heading_retract,
    heading_local, heading_residual,
)  # fmt: skip


class Case(NamedTuple):
    """A model and a recording."""

    model: Model
    params: Any
    observations: Any
    controls: Any
    dt: Any
    mask: Any


def case(name: str, samples: int = SAMPLES, masked: bool = True) -> Case:
    rng = np.random.default_rng(samples)

    def series(scale: float = 0.5) -> Any:
        return jnp.asarray(scale * rng.normal(size=samples))

    def mask(like: Any) -> Any:
        return jax.tree.map(lambda leaf: jnp.asarray(rng.random(samples) > 0.3), like) if masked else None

    p = jnp.asarray([0.3, 0.2, 0.1])
    dt = jnp.asarray(rng.uniform(0.01, 0.05, samples)) if masked else 0.02
    if name in ("cart", "bent", "heading"):
        seen = Reading(series(), series())
        controls = None if name == "heading" else Push(series())
        return Case({"cart": CART, "bent": BENT, "heading": HEADING}[name], p, seen, controls, dt, mask(seen))
    if name == "inclination":
        up = Vector(series(0.1), series(0.1), 1.0 + series(0.1))
        seen = inclination.InclinationObservation(up, Vector(series(0.1), series(0.1), series(0.1)))
        still = jnp.asarray(rng.random(samples) > 0.5)
        rate = Vector(series(), series(), series())
        controls = inclination.InclinationControl(rate, still, jnp.ones(samples, bool))
        return Case(inclination.MODEL, inclination.InclinationNoise(), seen, controls, dt, mask(seen))
    params = leg_model.LegModelParams(0.4, 0.41, 1e-6, 1.0, 1e-8, 1e-3, 2e-3, 1e-4)
    seen = leg_model.LegObservation(*(series(0.3) for _ in range(6)))
    controls = leg_model.LegControl(jnp.full(samples, 0.01), jnp.full(samples, 0.02))
    if name == "RATES":  # as `leg_ekf.PAPER` runs it: gyroscopes alone
        here = jnp.ones(samples, bool)
        return Case(leg_model.MODEL, params, seen, controls, 0.02, leg_model.LegObservation(here, here, *(~here,) * 4))
    return Case(leg_model.MODEL, params, seen, controls, dt, mask(seen))


def filtered(c: Case, execution: str = "auto", method: Any = ONE_UPDATE, keep: Any = FIELDS, **more: Any) -> Any:
    return filtering.kalman_filter(
        c.model, c.params, c.observations, controls=c.controls, dt=c.dt, mask=c.mask, method=method, keep=keep,
        execution=execution, **more,
    )  # fmt: skip


def smoothed(c: Case, execution: str, method: Any = ONE_UPDATE, **more: Any) -> Any:
    return filtering.kalman_smoother(
        c.model, c.params, c.observations, controls=c.controls, dt=c.dt, mask=c.mask, method=method,
        execution=execution, keep=("log_likelihood",), **more,
    )  # fmt: skip


def same(ours: Any, theirs: Any, tolerance: float = 1e-9) -> None:
    assert jax.tree.structure(ours) == jax.tree.structure(theirs)
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_allclose(np.asarray(a), np.asarray(b), rtol=tolerance, atol=tolerance)


EVERY = [
    ("cart", KF(), True), ("cart", EKF(), False), ("bent", EKF(), True), ("bent", IteratedEKF(3), False),
    ("heading", EKF(), True), ("heading", IteratedEKF(2), False), ("inclination", EKF(), True),
    ("MODEL", EKF(), True), ("MODEL", EKF(), False), ("RATES", EKF(), False), ("cart", IteratedEKF(2), True),
]  # fmt: skip


@pytest.mark.parametrize(("name", "method", "masked"), EVERY)
def test_the_fast_filter_is_the_dense_one(name, method, masked):
    c = case(name, masked=masked)
    same(filtered(c, "fast", method), filtered(c, "dense", method))


@pytest.mark.parametrize(
    ("name", "method", "masked"),
    [("cart", KF(), True), ("bent", IteratedEKF(2), True), ("heading", EKF(), True), ("MODEL", EKF(), False)],
)
def test_the_fast_smoother_is_the_dense_one(name, method, masked):
    c = case(name, masked=masked)
    dense = smoothed(c, "dense", method)
    same(smoothed(c, "fast", method), dense)
    means = smoothed(c, "fast", method, covariance=False)
    same(means.mean, dense.mean)
    assert means.cov is None


@pytest.mark.parametrize("samples", [289, 293])
def test_segments_change_nothing(samples):
    """289 = 17², and a prime, whose last segment is filled up."""
    c = case("bent", samples)
    dense = smoothed(c, "dense")
    same(smoothed(c, "fast"), dense)
    same(smoothed(c, "fast", covariance=False).mean, dense.mean)
    same(smoothed(c, "fast", form="bryson_frazier"), dense)
    assert samples >= fast.SEGMENTED_FROM

    def loss(p: Any, execution: str) -> Any:
        return jnp.sum(filtered(c._replace(params=p), execution, keep=("mean",)).mean.position ** 2)

    for gradient in (jax.grad, jax.jacfwd):
        same(jax.jit(gradient(partial(loss, execution="fast")))(c.params), jax.grad(loss)(c.params, "dense"), 1e-7)


def test_gradients_of_likelihood_and_smoothed_means():
    c = case("bent")

    def loss(p: Any, execution: str) -> Any:
        found = smoothed(c._replace(params=p), execution, covariance=False)
        return jnp.sum(found.mean.speed**2) - jnp.sum(found.filtered.log_likelihood)

    dense = jax.grad(loss)(c.params, "dense")
    same(jax.grad(loss)(c.params, "fast"), dense, 1e-7)
    second = jax.jit(jax.hessian(partial(loss, execution="fast")))(c.params)
    step = 1e-5
    for i in range(3):
        ahead, behind = (jax.grad(loss)(c.params.at[i].add(sign * step), "dense") for sign in (1.0, -1.0))
        np.testing.assert_allclose(second[i], (ahead - behind) / (2 * step), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("samples", [SAMPLES, 260])
def test_as_many_recordings_as_samples(samples):
    """A mix-up of the two axes would show in nothing but the numbers."""
    rng = np.random.default_rng(1)
    c = case("bent", samples, masked=False)
    batch = Reading(*(jnp.asarray(rng.normal(size=(samples, samples))) for _ in range(2)))

    def loss(p: Any, one: Reading, weight: Any) -> Any:
        found = filtered(c._replace(params=p, observations=one), "fast", keep=("mean", "log_likelihood"))
        return jnp.sum(weight * (found.mean.position - found.log_likelihood))

    weight = jnp.arange(samples, dtype=float) / samples
    ours = jax.jit(jax.vmap(jax.value_and_grad(loss), (None, 0, None)))(c.params, batch, weight)
    one = jax.jit(jax.value_and_grad(loss))
    for i in (0, samples // 2, samples - 1):
        alone = one(c.params, Reading(batch.near[i], batch.far[i]), weight)
        same((ours[0][i], ours[1][i]), alone, 1e-8)
    whole = jax.jit(jax.grad(lambda p: jnp.sum(jax.vmap(loss, (None, 0, None))(p, batch, weight))))(c.params)
    np.testing.assert_allclose(whole, jnp.sum(ours[1], axis=0), rtol=1e-8)


def test_a_broken_step_is_the_same_in_both():
    c = case("cart")
    pushes = c.controls.acceleration.at[7].set(1.0)
    model = c.model._replace(transition=cliff_transition)
    broken = c._replace(model=model, controls=Push(jnp.where(jnp.arange(SAMPLES) == 7, 100.0, pushes)))
    found = filtered(broken, "fast")
    assert not bool(found.valid[7])
    assert int(jnp.sum(~found.valid)) == 1
    same(found, filtered(broken, "dense"))
    negative = case("cart")._replace(params=jnp.asarray([0.3, -50.0, 0.1]))
    found = filtered(negative, "fast")
    assert not bool(jnp.all(found.valid))
    same(found, filtered(negative, "dense"))


def cliff_transition(p: Any, s: Cart, u: Push, dt: Any) -> Cart:
    moved = cart_transition(p, s, u, dt)
    return moved._replace(speed=moved.speed + jnp.where(u.acceleration > 50.0, jnp.inf, 0.0))


@pytest.mark.parametrize("name", ["cart", "bent", "heading"])
def test_square_roots_and_parallel_scans_answer_the_same_call(name):
    c = case(name)
    dense = smoothed(c, "dense")
    same(smoothed(c, "square_root"), dense, 1e-8)
    if name == "cart":
        same(smoothed(c, "parallel", KF()), dense, 1e-8)
    if name == "bent":
        about = dense.mean
        for _ in range(30):
            about = smoothed(c, "parallel", about=about).mean
        same(smoothed(c, "parallel", about=about).mean, about, 1e-6)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"execution": "fast", "method": UKF()}, "execution='fast' has KF, EKF and iterated EKF; got UKF"),
        ({"execution": "parallel", "method": CKF()}, r"execution='parallel' has KF\(\) and EKF\(\)"),
        ({"execution": "parallel", "method": EKF()}, "needs `about`"),
        ({"execution": "swift"}, "execution must be one of auto, fast, dense, square_root, parallel; got 'swift'"),
        ({"execution": "fast", "method": KF()}, "the Jacobian of transition .* depends on the state"),
    ],
)
def test_what_cannot_be_done_is_refused(more, message):
    with pytest.raises(ValueError, match=message):
        filtered(case("bent"), **more)


def test_a_trajectory_of_another_shape_is_refused():
    c = case("bent")
    with pytest.raises(ValueError, match="about must hold arrays of shape"):
        filtered(c, "parallel", about=Cart(jnp.zeros(3), jnp.zeros(3)))
    with pytest.raises(ValueError, match="about is the trajectory of execution='parallel'"):
        filtered(c, "dense", about=c.observations)


def test_constants_of_a_jacobian_are_found():
    c = case("MODEL")
    given = inputs(c.model, c.params, c.observations, c.controls, 0.02, None, None)
    control = jax.tree.map(lambda leaf: leaf[0], c.controls)
    x = [jnp.asarray(0.1 * i) for i in range(8)]
    _, matrix = Expansion(jnp.float64).jacobian(lambda x: given.cm.transition(x, control, 0.02), x)
    found = np.array([[entry if known(entry) else np.nan for entry in row] for row in matrix])
    truth = np.asarray(jax.jacfwd(lambda v: jnp.stack(given.cm.transition(list(v), control, 0.02)))(jnp.stack(x)))
    assert np.isnan(found).sum() == 8
    np.testing.assert_array_equal(found[~np.isnan(found)], truth[~np.isnan(found)])
    np.testing.assert_allclose(np.array(matrix, dtype=float), truth, atol=1e-15)


def test_compiled_for_wide_vectors_also_within_another_jit():
    double = filtering.compiled(lambda x, times: x * times, static_argnames=("times",))
    assert float(double(jnp.asarray(2.0), times=3)) == 6.0
    assert float(jax.jit(lambda x: double(x, times=4))(2.0)) == 8.0
    assert float(jax.grad(lambda x: double(x, times=5))(2.0)) == 5.0


def test_a_bare_array_is_refused_with_what_is_expected():
    c = case("bent")
    with pytest.raises(
        ValueError, match=r"observes a Reading of \(near, far\); got a bare array; pass Reading\(near=…"
    ):
        filtered(c._replace(observations=c.observations.near, mask=None))


@pytest.mark.parametrize(
    ("name", "method", "masked"), [("cart", KF(), True), ("bent", IteratedEKF(2), True), ("bent", ONE_UPDATE, False)]
)
def test_without_inverses_it_is_the_same_smoother(name, method, masked):
    c = case(name, masked=masked)
    same(smoothed(c, "fast", method, form="bryson_frazier"), smoothed(c, "dense", method))


def test_some_components_are_those_of_all():
    c = case("cart")
    every = smoothed(c, "dense")
    for execution in ("fast", "dense"):
        some = smoothed(c, execution, covariance=("speed",))
        assert some.cov.names == ("speed",)
        same(some.cov["speed", "speed"], every.cov["speed", "speed"])
        same(some.mean, every.mean)
    with_rts = smoothed(c, "fast", form="rts", covariance=("speed", "position"))
    same(with_rts.cov, every.cov)


def test_gradients_without_inverses():
    c = case("bent")

    def loss(p: Any, execution: str, form: str) -> Any:
        found = smoothed(c._replace(params=p), execution, form=form)
        return jnp.sum(found.mean.speed**2) + jnp.sum(found.cov["position", "speed"])

    same(jax.grad(loss)(c.params, "fast", "bryson_frazier"), jax.grad(loss)(c.params, "dense", "rts"), 1e-7)


def test_a_broken_step_without_inverses():
    c = case("cart")
    pushes = jnp.where(jnp.arange(SAMPLES) == 7, 100.0, c.controls.acceleration)
    broken = c._replace(model=c.model._replace(transition=cliff_transition), controls=Push(pushes))
    same(smoothed(broken, "fast", form="bryson_frazier"), smoothed(broken, "dense"))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"form": "two_filter"}, "form must be 'auto', 'rts' or 'bryson_frazier'; got 'two_filter'"),
        ({"covariance": "speed"}, "covariance is True, False or a tuple of names; got 'speed'"),
        ({"covariance": ("height",)}, r"covariance names components of the error \(position, speed\); got 'height'"),
    ],
)
def test_what_a_smoother_cannot_do_is_refused(more, message):
    with pytest.raises(ValueError, match=message):
        smoothed(case("cart"), "fast", **more)
    with pytest.raises(ValueError, match="form='bryson_frazier' belongs to execution='fast'; this is 'dense'"):
        smoothed(case("cart"), "dense", form="bryson_frazier")
