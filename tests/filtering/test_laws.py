"""What must hold for every Gaussian filter, whatever it estimates."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait import filtering
from jgait.filtering import CKF, EKF, KF, UKF, Belief, Covariance, IteratedEKF, Model

METHODS = [KF(), EKF(), IteratedEKF(2), IteratedEKF(5), UKF(), UKF(iterations=3), CKF(), CKF(iterations=2)]
SAMPLES = 25


class Cart(NamedTuple):
    """Position and speed."""

    position: Any
    speed: Any


class Seen(NamedTuple):
    """Two readings of the position and one of the speed."""

    first: Any
    second: Any
    speed: Any


class Push(NamedTuple):
    """Acceleration over the interval."""

    acceleration: Any


class CartParams(NamedTuple):
    """Spectral density of the process noise, variance of the readings, friction."""

    q: Any = 0.3
    r: Any = 0.2
    friction: Any = 0.1


def cart_initial(p: CartParams) -> Belief:
    del p
    return Belief(Cart(0.5, -0.2), Covariance.from_variances(Cart(2.0, 1.0)).with_entries({("speed", "position"): 0.3}))


def cart_transition(p: CartParams, s: Cart, u: Push, dt: Any) -> Cart:
    return Cart(
        s.position + dt * s.speed + 0.5 * dt * dt * u.acceleration,
        (1.0 - p.friction * dt) * s.speed + dt * u.acceleration,
    )


def cart_noise(p: CartParams, s: Cart, u: Push, dt: Any) -> Covariance:
    del s, u
    variances = Cart(p.q * dt**3 / 3.0, p.q * dt)
    return Covariance.from_variances(variances).with_entries({("position", "speed"): p.q * dt**2 / 2.0})


def cart_observation(p: CartParams, s: Cart, u: Push) -> Seen:
    del p
    return Seen(s.position, 2.0 * s.position + 0.1 * u.acceleration, s.speed)


def cart_reading_noise(p: CartParams, s: Cart, u: Push) -> Covariance:
    del s, u
    return Covariance.from_variances(Seen(p.r, 2.0 * p.r, p.r)).with_entries({("first", "speed"): 0.3 * p.r})


CART = Model(cart_initial, cart_transition, cart_noise, cart_observation, cart_reading_noise)


class Problem(NamedTuple):
    """One recording, and the same as matrices."""

    seen: Seen
    push: Push
    dt: np.ndarray
    mask: Seen


@pytest.fixture(scope="module")
def problem() -> Problem:
    rng = np.random.default_rng(0)
    seen = Seen(*(jnp.asarray(rng.normal(size=SAMPLES)) for _ in range(3)))
    mask = Seen(*(jnp.asarray(rng.random(SAMPLES) > 0.3) for _ in range(3)))
    mask = mask._replace(
        first=mask.first.at[7].set(False), second=mask.second.at[7].set(False), speed=mask.speed.at[7].set(False)
    )
    return Problem(seen, Push(jnp.asarray(rng.normal(size=SAMPLES))), rng.uniform(0.05, 0.4, SAMPLES), mask)


def matrices(p: CartParams, dt: float):
    f = np.array([[1.0, dt], [0.0, 1.0 - p.friction * dt]])
    q = p.q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    h = np.array([[1.0, 0.0], [2.0, 0.0], [0.0, 1.0]])
    r = p.r * np.array([[1.0, 0.0, 0.3], [0.0, 2.0, 0.0], [0.3, 0.0, 1.0]])
    return f, q, h, r


PRIOR = np.array([0.5, -0.2]), np.array([[2.0, 0.3], [0.3, 1.0]])


def by_hand(problem: Problem, p: CartParams = CartParams()):  # noqa: B008
    """The Kalman filter in NumPy: rows that were not seen are deleted."""
    mean, cov = PRIOR
    means, covs, total = [], [], 0.0
    for k in range(SAMPLES):
        f, q, h, r = matrices(p, problem.dt[k])
        u = float(problem.push.acceleration[k])
        mean = f @ mean + np.array([0.5 * problem.dt[k] ** 2, problem.dt[k]]) * u
        cov = f @ cov @ f.T + q
        rows = [i for i in range(3) if bool(problem.mask[i][k])]
        if rows:
            y = np.array([float(problem.seen[i][k]) for i in rows])
            error = y - (h @ mean + np.array([0.0, 0.1 * u, 0.0]))[rows]
            s = h[rows] @ cov @ h[rows].T + r[np.ix_(rows, rows)]
            gain = cov @ h[rows].T @ np.linalg.inv(s)
            mean, cov = mean + gain @ error, cov - gain @ s @ gain.T
            total += -0.5 * (error @ np.linalg.solve(s, error) + np.linalg.slogdet(2 * np.pi * s)[1])
        means.append(mean)
        covs.append(cov)
    return np.array(means), np.array(covs), total


def least_squares(problem: Problem, p: CartParams = CartParams()):  # noqa: B008
    """All states at once: the joint Gaussian of prior, transitions and readings, solved as one linear system."""
    size = 2 * (SAMPLES + 1)
    information, right = np.zeros((size, size)), np.zeros(size)

    def add(rows: np.ndarray, value: np.ndarray, cov: np.ndarray) -> None:
        nonlocal information, right
        weight = np.linalg.inv(cov)
        information += rows.T @ weight @ rows
        right += rows.T @ weight @ value

    def block(k: int) -> np.ndarray:
        out = np.zeros((2, size))
        out[:, 2 * k : 2 * k + 2] = np.eye(2)
        return out

    add(block(0), PRIOR[0], PRIOR[1])
    for k in range(SAMPLES):
        f, q, h, r = matrices(p, problem.dt[k])
        u = float(problem.push.acceleration[k])
        add(block(k + 1) - f @ block(k), np.array([0.5 * problem.dt[k] ** 2, problem.dt[k]]) * u, q)
        rows = [i for i in range(3) if bool(problem.mask[i][k])]
        if rows:
            y = np.array([float(problem.seen[i][k]) for i in rows]) - np.array([0.0, 0.1 * u, 0.0])[rows]
            add(h[rows] @ block(k + 1), y, r[np.ix_(rows, rows)])
    cov = np.linalg.inv(information)
    mean = cov @ right
    return mean.reshape(-1, 2)[1:], np.array([cov[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(1, SAMPLES + 1)])


def filtered(problem: Problem, method: Any = EKF(), p: CartParams = CartParams()):  # noqa: B008
    return filtering.kalman_filter(
        CART, p, problem.seen, controls=problem.push, dt=problem.dt, mask=problem.mask, method=method
    )


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_every_filter_is_the_kalman_filter_on_a_linear_model(problem, method):
    posterior = filtered(problem, method)
    means, covs, total = by_hand(problem)
    np.testing.assert_allclose(np.stack(posterior.mean, -1), means, atol=1e-10)
    np.testing.assert_allclose(np.asarray(posterior.cov.dense()), covs, atol=1e-10)
    assert float(jnp.sum(posterior.log_likelihood)) == pytest.approx(total, abs=1e-9)
    assert bool(jnp.all(posterior.valid))


@pytest.mark.parametrize("method", [EKF(), UKF(), CKF()], ids=str)
def test_smoothing_is_batch_least_squares(problem, method):
    smoothed = filtering.kalman_smoother(
        CART, CartParams(), problem.seen, controls=problem.push, dt=problem.dt, mask=problem.mask, method=method
    )
    means, covs = least_squares(problem)
    np.testing.assert_allclose(np.stack(smoothed.mean, -1), means, atol=1e-10)
    np.testing.assert_allclose(np.asarray(smoothed.cov.dense()), covs, atol=1e-10)


def test_likelihood_is_the_joint_density_of_the_readings(problem):
    everything = problem._replace(mask=jax.tree.map(jnp.ones_like, problem.mask))
    p, few = CartParams(), 4
    mean, cov, blocks = PRIOR[0], PRIOR[1], []
    cross = []
    for k in range(few):
        f, q, _, _ = matrices(p, problem.dt[k])
        mean = f @ mean + np.array([0.5 * problem.dt[k] ** 2, problem.dt[k]]) * float(problem.push.acceleration[k])
        cross = [f @ c for c in cross]
        cov = f @ cov @ f.T + q
        cross.append(cov)
        blocks.append((mean, list(cross)))
    h, r = matrices(p, 1.0)[2:]
    joint = np.zeros((3 * few, 3 * few))
    centre = np.zeros(3 * few)
    for k, (m, before) in enumerate(blocks):
        centre[3 * k : 3 * k + 3] = h @ m + np.array([0.0, 0.1 * float(problem.push.acceleration[k]), 0.0])
        for j, c in enumerate(before):
            joint[3 * k : 3 * k + 3, 3 * j : 3 * j + 3] = h @ c @ h.T
            joint[3 * j : 3 * j + 3, 3 * k : 3 * k + 3] = (h @ c @ h.T).T
        joint[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = h @ before[k] @ h.T + r
    y = np.stack(everything.seen, -1)[:few].reshape(-1) - centre
    density = -0.5 * (y @ np.linalg.solve(joint, y) + np.linalg.slogdet(2 * np.pi * joint)[1])
    assert float(jnp.sum(filtered(everything).log_likelihood[:few])) == pytest.approx(density, abs=1e-9)


def test_an_all_false_mask_is_prediction_only(problem):
    blind = filtered(problem._replace(mask=jax.tree.map(jnp.zeros_like, problem.mask)))
    belief = CART.initial(CartParams())
    for k in range(SAMPLES):
        control = Push(problem.push.acceleration[k])
        belief = filtering.predict(CART, CartParams(), belief, control=control, dt=problem.dt[k], method=EKF())
        assert float(blind.mean.position[k]) == pytest.approx(float(belief.mean.position), abs=1e-12)
        assert float(blind.cov["speed", "speed"][k]) == pytest.approx(float(belief.cov["speed", "speed"]), abs=1e-12)
    assert float(jnp.sum(blind.log_likelihood)) == 0.0
    assert float(jnp.sum(blind.nis)) == 0.0
    assert not np.any(np.asarray(blind.count))


def test_what_the_mask_hides_changes_nothing(problem):
    spoiled = problem._replace(seen=jax.tree.map(lambda v, m: jnp.where(m, v, 1e6), problem.seen, problem.mask))
    for a, b in zip(jax.tree.leaves(filtered(problem)), jax.tree.leaves(filtered(spoiled)), strict=True):
        np.testing.assert_array_equal(np.asarray(a), np.asarray(b))


@pytest.mark.parametrize("method", [EKF(), UKF()], ids=str)
def test_online_equals_offline(problem, method):
    posterior = filtered(problem, method)
    belief = CART.initial(CartParams())
    for k in range(SAMPLES):

        def at(tree: Any, k: int = k) -> Any:
            return jax.tree.map(lambda v: v[k], tree)

        now = filtering.step(
            CART, CartParams(), belief, at(problem.seen), control=at(problem.push), dt=problem.dt[k],
            mask=at(problem.mask), method=method,
        )  # fmt: skip
        belief = now.belief
        np.testing.assert_allclose(np.stack(belief.mean), np.stack(at(posterior.mean)), rtol=0, atol=1e-13)
        np.testing.assert_allclose(belief.cov.dense(), at(posterior.cov).dense(), rtol=0, atol=1e-13)


def test_vmap_equals_a_loop_and_padding_changes_nothing(problem):
    scales = jnp.array([0.5, 1.0, 2.0])
    mapped = jax.vmap(lambda r: filtered(problem, p=CartParams(r=r)))(scales)
    for k, scale in enumerate(scales):
        alone = filtered(problem, p=CartParams(r=scale))
        np.testing.assert_allclose(mapped.mean.position[k], alone.mean.position, atol=1e-12)
    longer = Problem(
        *(jax.tree.map(lambda v: jnp.pad(v, (0, 7)), tree) for tree in (problem.seen, problem.push)),
        np.pad(problem.dt, (0, 7), constant_values=0.1),
        jax.tree.map(lambda v: jnp.pad(v, (0, 7)), problem.mask),
    )
    padded = filtered(longer)
    np.testing.assert_array_equal(padded.mean.speed[:SAMPLES], filtered(problem).mean.speed)
    assert float(jnp.sum(padded.log_likelihood)) == pytest.approx(float(jnp.sum(filtered(problem).log_likelihood)))


@pytest.mark.parametrize("smooth", [False, True])
def test_gradients_equal_finite_differences(problem, smooth):
    solve = filtering.kalman_smoother if smooth else filtering.kalman_filter

    def value(v: Any) -> Any:
        p = CartParams(jnp.exp(v[0]), jnp.exp(v[1]), v[2])
        out = solve(CART, p, problem.seen, controls=problem.push, dt=problem.dt, mask=problem.mask)
        posterior = out.filtered if smooth else out
        return jnp.sum(out.mean.position**2) + jnp.sum(out.cov["speed", "speed"]) + jnp.sum(posterior.log_likelihood)

    at = jnp.array([-1.0, -1.5, 0.1])
    value = jax.jit(value)
    gradient = jax.grad(value)(at)
    for k in range(3):
        step = jnp.zeros(3).at[k].set(1e-5)
        by_differences = (float(value(at + step)) - float(value(at - step))) / 2e-5
        assert float(gradient[k]) == pytest.approx(by_differences, rel=1e-5)


def test_gradients_are_finite_in_float32(problem):
    def single(tree: Any) -> Any:
        return jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), tree)

    def value(v: Any) -> Any:
        out = filtering.kalman_smoother(
            CART, CartParams(v[0], v[1], v[2]), single(problem.seen), controls=single(problem.push),
            dt=single(problem.dt), mask=problem.mask,
        )  # fmt: skip
        return jnp.sum(out.mean.position**2) + jnp.sum(out.filtered.log_likelihood)

    gradient = jax.jit(jax.grad(value))(jnp.array([0.3, 0.2, 0.1], jnp.float32))
    assert gradient.dtype == jnp.float32
    assert bool(jnp.all(jnp.isfinite(gradient)))


class Pendulum(NamedTuple):
    """Angle from hanging, and its rate."""

    angle: Any
    rate: Any


class Shadow(NamedTuple):
    """Where the bob's shadow falls."""

    x: Any


def pendulum_initial(p: Any) -> Belief:
    del p
    return Belief(Pendulum(0.8, 0.0), Covariance.from_variances(Pendulum(0.2, 0.1)))


def pendulum_transition(p: Any, s: Pendulum, u: Any, dt: Any) -> Pendulum:
    del u
    return Pendulum(s.angle + dt * s.rate, s.rate - dt * p * jnp.sin(s.angle))


def pendulum_noise(p: Any, s: Pendulum, u: Any, dt: Any) -> Pendulum:
    del p, s, u
    return Pendulum(1e-4 * dt, 1e-2 * dt)


def pendulum_shadow(p: Any, s: Pendulum, u: Any) -> Shadow:
    del p, u
    return Shadow(jnp.sin(s.angle))


def shadow_noise(p: Any, s: Pendulum, u: Any) -> Shadow:
    del p, s, u
    return Shadow(0.01)


PENDULUM = Model(pendulum_initial, pendulum_transition, pendulum_noise, pendulum_shadow, shadow_noise)


def swing(seed: int, samples: int = 200, dt: float = 0.05):
    rng = np.random.default_rng(seed)
    angle, rate = 0.8 + np.sqrt(0.2) * rng.normal(), np.sqrt(0.1) * rng.normal()
    angles, shadows = [], []
    for _ in range(samples):
        angle, rate = (
            angle + dt * rate + np.sqrt(1e-4 * dt) * rng.normal(),
            rate - dt * 9.81 * np.sin(angle) + np.sqrt(1e-2 * dt) * rng.normal(),
        )
        angles.append(angle)
        shadows.append(np.sin(angle) + 0.1 * rng.normal())
    return np.array(angles), np.array(shadows)


def test_ekf_on_a_pendulum_is_the_textbooks():
    _, shadows = swing(1)
    posterior = filtering.kalman_filter(PENDULUM, 9.81, Shadow(jnp.asarray(shadows)), dt=0.05)
    mean, cov, dt = np.array([0.8, 0.0]), np.diag([0.2, 0.1]), 0.05
    for k, y in enumerate(shadows):
        f = np.array([[1.0, dt], [-dt * 9.81 * np.cos(mean[0]), 1.0]])
        mean = np.array([mean[0] + dt * mean[1], mean[1] - dt * 9.81 * np.sin(mean[0])])
        cov = f @ cov @ f.T + np.diag([1e-4 * dt, 1e-2 * dt])
        h = np.array([[np.cos(mean[0]), 0.0]])
        s = h @ cov @ h.T + 0.01
        gain = cov @ h.T / s
        mean, cov = mean + gain[:, 0] * (y - np.sin(mean[0])), cov - gain @ s @ gain.T
        np.testing.assert_allclose([posterior.mean.angle[k], posterior.mean.rate[k]], mean, atol=1e-9)
    np.testing.assert_allclose(posterior.cov.dense()[-1], cov, atol=1e-10)


@pytest.mark.parametrize("method", [EKF(), IteratedEKF(3), UKF(), CKF()], ids=str)
def test_filters_are_consistent_on_a_pendulum(method):
    runs = 40
    truth, shadows = (np.stack(v) for v in zip(*(swing(seed) for seed in range(runs)), strict=True))
    posterior = jax.vmap(lambda x: filtering.kalman_filter(PENDULUM, 9.81, Shadow(x), dt=0.05, method=method))(
        jnp.asarray(shadows)
    )
    error = np.asarray(posterior.mean.angle)[:, 50::50] - truth[:, 50::50]
    nees = error**2 / np.asarray(posterior.cov["angle", "angle"])[:, 50::50]
    assert abs(nees.mean() - 1.0) < 6.0 * np.sqrt(2.0 / nees.size)
    nis = np.asarray(posterior.nis)[:, 20:]
    assert abs(nis.mean() - 1.0) < 6.0 * np.sqrt(2.0 / nis.size)


def test_the_kf_refuses_a_nonlinear_model():
    with pytest.raises(ValueError, match="the KF needs a linear model"):
        filtering.kalman_filter(PENDULUM, 9.81, Shadow(jnp.zeros(3)), dt=0.05, method=KF())


def walk_initial(p: Any) -> Belief:
    zero = jnp.zeros_like(p)
    return Belief(Cart(zero, zero), Covariance.from_variances(Cart(100.0, 100.0)))


def walk_noise(p: Any, s: Cart, u: Any, dt: Any) -> Cart:
    del p, s, u
    return Cart(1e-8 * dt, 1e-6 * dt)


def walk_transition(p: Any, s: Cart, u: Any, dt: Any) -> Cart:
    del p, u
    return Cart(s.position + dt * s.speed, s.speed)


def walk_observation(p: Any, s: Cart, u: Any) -> Shadow:
    del p, u
    return Shadow(s.speed)


def walk_reading(p: Any, s: Cart, u: Any) -> Shadow:
    del s, u
    return Shadow(p)


ZERO_VELOCITY = Model(walk_initial, walk_transition, walk_noise, walk_observation, walk_reading)


def test_joseph_form_holds_in_float32_where_the_short_form_fails():
    samples = 2000
    fine, coarse = (
        filtering.kalman_filter(
            ZERO_VELOCITY, jnp.asarray(1e-6, kind), Shadow(jnp.zeros(samples, kind)), dt=jnp.asarray(0.01, kind)
        ).cov
        for kind in (jnp.float64, jnp.float32)
    )
    ours = np.abs(np.asarray(coarse["speed", "speed"], np.float64) / np.asarray(fine["speed", "speed"]) - 1.0).max()
    cov, dt = np.diag([100.0, 100.0]).astype(np.float32), np.float32(0.01)
    f, h = np.array([[1, dt], [0, 1]], np.float32), np.array([[0, 1]], np.float32)
    short = []
    for _ in range(samples):
        cov = f @ cov @ f.T + np.diag([1e-10, 1e-8]).astype(np.float32)
        s = h @ cov @ h.T + np.float32(1e-6)
        gain = cov @ h.T / s
        cov = cov - gain @ s @ gain.T
        short.append(cov[1, 1])
    theirs = np.abs(np.asarray(short, np.float64) / np.asarray(fine["speed", "speed"]) - 1.0).max()
    assert ours < 1e-2
    assert theirs > 10.0 * ours


def test_exactly_known_states_do_not_break_smoothing_or_sigma_points(problem):
    known = Belief(Cart(jnp.asarray(0.0), jnp.asarray(1.0)), Covariance.from_variances(Cart(0.0, 0.0)))

    def last(scale: Any, method: Any) -> Any:
        p = CartParams(q=0.0 * scale, r=scale)
        out = filtering.kalman_smoother(
            CART, p, problem.seen, controls=problem.push, dt=problem.dt, method=method, initial=known
        )
        return out.mean.position[-1] + out.cov["position", "position"][0]

    for method in (EKF(), UKF()):
        value, slope = jax.value_and_grad(last)(jnp.asarray(0.2), method)
        assert np.isfinite(float(value))
        assert np.isfinite(float(slope))


def negative_noise(p: Any, s: Pendulum, u: Any) -> Shadow:
    del p, s
    return Shadow(jnp.where(u.acceleration > 0.0, -10.0, 0.01))


def test_a_broken_step_keeps_the_prediction_and_says_so():
    model = PENDULUM._replace(observation_noise=negative_noise)
    control = Push(jnp.array([0.0, 1.0, 0.0]))
    keep = ("mean", "cov", "predicted_mean", "predicted_cov", "valid", "nis")
    out = filtering.kalman_filter(model, 9.81, Shadow(jnp.full(3, 0.1)), controls=control, dt=0.05, keep=keep)
    np.testing.assert_array_equal(out.valid, [True, False, True])
    assert float(out.mean.angle[1]) == float(out.predicted_mean.angle[1])
    assert float(out.cov["angle", "angle"][1]) == float(out.predicted_cov["angle", "angle"][1])
    assert np.all(np.isfinite(np.asarray(out.mean.rate)))
    assert float(out.nis[1]) == 0.0
