"""The virtual inertial sensor: each error by its statistics, its filters against SciPy, and what JAX asks of it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import butter, lfilter, sawtooth
from scipy.spatial.transform import Rotation

from jgait.geometry.vectors import GRAVITY
from jgait.simulate.sensors import IDEAL, ImuErrors, check_errors, measure, turn

RATE = 100.0
T = 600
TIME = np.arange(float(T)) / RATE
STANDING = np.tile([0.0, 0.0, GRAVITY], (T, 1))
GYR = np.stack([np.sin(7.0 * TIME), 3.0 * np.sin(5.0 * TIME), np.cos(3.0 * TIME)], axis=1)
ACC = STANDING + np.stack([4.0 * np.sin(6.0 * TIME), np.sin(9.0 * TIME), 8.0 * np.sin(4.0 * TIME) ** 3], axis=1)
KEY = jax.random.key(0)
KEYS = jax.random.split(jax.random.key(7), 300)

compiled = jax.jit(measure)
read_many = jax.jit(jax.vmap(measure, in_axes=(0, None, None, None, None)))


def read(key, time, gyr, acc, errors):
    """One trial; all errors as arrays, so that every test finds it compiled."""
    imu = compiled(key, time, gyr, acc, jax.tree.map(lambda leaf: np.asarray(leaf, time.dtype), errors))
    return jax.tree.map(np.asarray, imu)


def within(values, expected):
    """The standard deviation of independent normal numbers about zero is as expected, within six of its own."""
    measured = np.sqrt(np.mean(np.square(values)))
    assert measured == pytest.approx(expected, rel=6.0 / np.sqrt(2 * np.size(values)))


def trials(errors):
    """Errors of the readings (trials, 5, 6) of a sensor that turns and is pushed evenly."""
    even = np.full((5, 3), 2.0)
    imu = read_many(KEYS, TIME[:5], even, even, errors)
    return np.concatenate([imu.gyr, imu.acc], axis=2) - 2.0


# --- errors, by their statistics ---


def test_a_perfect_sensor_reads_the_motion():
    imu = read(KEY, TIME, GYR, ACC, IDEAL)
    np.testing.assert_allclose(imu.gyr, GYR, rtol=0, atol=1e-12)
    np.testing.assert_allclose(imu.acc, ACC, rtol=0, atol=1e-12)
    assert imu.mask.dtype == jnp.bool_ and bool(imu.mask.all())
    np.testing.assert_array_equal(imu.time, TIME)


def test_white_noise_has_its_density():
    imu = read(KEY, TIME, GYR, ACC, ImuErrors(gyr_noise=0.01, acc_noise=0.02))
    for part, exact, density in ((imu.gyr, GYR, 0.01), (imu.acc, ACC, 0.02)):
        error = np.asarray(part - exact)
        within(error, density * np.sqrt(RATE / 2))
        lagged = np.mean(error[1:] * error[:-1]) / np.mean(error**2)
        assert abs(lagged) < 6.0 / np.sqrt(error.size)


@pytest.mark.parametrize("sensor", ["gyr", "acc"])
def test_bias_scale_and_drift_spread_over_trials(sensor):
    columns, others = (slice(0, 3), slice(3, 6))[:: 1 if sensor == "gyr" else -1]
    bias = trials(ImuErrors(**{f"{sensor}_bias": 0.1}))
    assert np.ptp(bias, axis=1).max() < 1e-12
    within(bias[:, 0, columns], 0.1)
    scale = trials(ImuErrors(**{f"{sensor}_scale": 0.03}))
    within(scale[:, 0, columns], 0.03 * 2.0)
    drift = trials(ImuErrors(**{f"{sensor}_drift": 0.5}))
    within(np.diff(drift, axis=1)[..., columns], 0.5 / np.sqrt(RATE))
    within(drift[:, -1, columns], 0.5 * np.sqrt(5 / RATE))
    for error in (bias, scale, drift):
        np.testing.assert_allclose(error[..., others], 0.0, atol=1e-12)
        assert abs(np.corrcoef(error[:, -1, columns].T)[0, 1]) < 6.0 / np.sqrt(len(KEYS))


def test_mounting_turns_both_sensors_alike_by_the_angle_stated():
    imu = read_many(KEYS, TIME[:5], GYR[:5], ACC[:5], ImuErrors(mounting=0.1))
    angles = []
    for trial in range(60):
        ours = np.concatenate([imu.gyr[trial], imu.acc[trial]])
        turned, rest = Rotation.align_vectors(np.concatenate([GYR[:5], ACC[:5]]), ours)
        assert rest < 1e-6  # the residual is the root of a rounding error
        angles.append(turned.magnitude())
    within(angles, 0.1)


def test_a_fixed_mounting_is_the_rotation_vector_from_segment_to_sensor():
    vector = np.array([0.3, -0.8, 1.1])
    errors = ImuErrors(mounting_x=vector[0], mounting_y=vector[1], mounting_z=vector[2])
    turned = Rotation.from_rotvec(vector).inv()
    imu = read(KEY, TIME, GYR, ACC, errors)
    np.testing.assert_allclose(imu.gyr, turned.apply(np.asarray(GYR)), rtol=0, atol=1e-12)
    np.testing.assert_allclose(imu.acc, turned.apply(np.asarray(ACC)), rtol=0, atol=1e-12)
    axis = np.array([0.0, 2.0, -1.0])
    exact = Rotation.from_rotvec(0.7 * axis / np.linalg.norm(axis)).as_matrix()
    np.testing.assert_allclose(jax.jit(turn)(axis, 0.7), exact, rtol=0, atol=1e-12)


def test_the_converter_rounds_and_saturates():
    noisy = ImuErrors(gyr_noise=0.01, acc_noise=0.02)
    fine = read(KEY, TIME, GYR, ACC, noisy)
    coarse = read(KEY, TIME, GYR, ACC, noisy._replace(gyr_resolution=0.04, acc_resolution=0.3))
    clipped = read(KEY, TIME, GYR, ACC, noisy._replace(gyr_range=1.5, acc_range=9.0))
    for part, step, limit in (("gyr", 0.04, 1.5), ("acc", 0.3, 9.0)):
        values, steps = np.asarray(getattr(fine, part)), np.asarray(getattr(coarse, part)) / step
        np.testing.assert_allclose(steps, np.round(steps), rtol=0, atol=1e-9)
        assert np.abs(steps * step - values).max() <= step / 2 + 1e-12
        np.testing.assert_array_equal(getattr(clipped, part), np.clip(values, -limit, limit))
        assert np.abs(values).max() > limit


def test_single_samples_are_lost_as_often_as_stated():
    imu = read(KEY, TIME, GYR, ACC, ImuErrors(packet_loss=0.2))
    lost = ~np.asarray(imu.mask)
    assert lost.mean() == pytest.approx(0.2, abs=6.0 * np.sqrt(0.16 / T))
    assert np.all(np.asarray(imu.gyr)[lost] == 0.0) and np.all(np.asarray(imu.acc)[lost] == 0.0)
    np.testing.assert_allclose(np.asarray(imu.acc)[~lost], np.asarray(ACC)[~lost], rtol=0, atol=1e-12)


# --- filters ---


def test_the_bandwidth_is_where_the_amplitude_falls_by_the_root_of_two():
    tone = np.tile(np.sin(2.0 * np.pi * 12.0 * TIME)[:, None], 3)
    imu = read(KEY, TIME, tone, tone, ImuErrors(gyr_bandwidth=12.0, acc_bandwidth=20.0))
    whole = slice(T - 400, T)  # periods of 12 Hz in 4 s: the root mean square is exact
    assert np.sqrt(2.0) * np.std(imu.gyr[whole, 0]) == pytest.approx(np.sqrt(0.5), abs=1e-9)
    assert 0.9 < np.sqrt(2.0) * np.std(imu.acc[whole, 0]) < 0.999
    still = read(KEY, TIME, 0.0 * GYR, STANDING, ImuErrors(acc_bandwidth=5.0))  # no transient at the start
    np.testing.assert_allclose(still.acc, STANDING, rtol=0, atol=1e-12)


def shaken(rate, errors, seconds=120.0):
    """Readings of a sensor that rests for two seconds, then turns by 2 rad/s and is pushed, less the motion."""
    time = np.arange(seconds * rate) / rate
    moves = (time >= 2.0)[:, None]
    gyr = moves * 2.0 * np.sqrt(2.0) * np.sin(2.0 * np.pi * 5.0 * time)[:, None] * [0.0, 1.0, 0.0]
    acc = [0.0, 0.0, GRAVITY] + moves * 3.0 * sawtooth(2.0 * np.pi * (time - 2.0), 0.5)[:, None] * [1.0, 0.0, 0.0]
    imu = compiled(KEY, time, gyr, acc, jax.tree.map(np.asarray, errors))
    late = time >= 4.0
    jolt = np.sqrt(np.mean((np.diff(acc[late], axis=0) * rate * 0.005) ** 2) * 3.0)
    return time, gyr, acc, imu, late, jolt


@pytest.mark.parametrize("rate", [100.0])
def test_a_sensor_sways_in_proportion_to_the_motion_and_rests_with_it(rate):
    time, gyr, acc, imu, late, _ = shaken(rate, ImuErrors(sway=0.1, sway_arm=0.07))
    swayed = np.asarray(imu.gyr) - gyr
    np.testing.assert_allclose(swayed[late].std(axis=0), 0.2, rtol=0.1)
    assert np.abs(swayed[time < 2.0]).max() < 1e-6
    # the turns follow from the rates, and from them what the sensor's place and gravity do to the accelerometer
    turns = np.zeros_like(gyr)
    for i in range(1, len(time)):
        turns[i] = turns[i - 1] + (swayed[i] + np.cross(turns[i - 1], gyr[i])) / rate
    x, y, _ = np.gradient(np.gradient(turns, axis=0), axis=0).T * rate**2
    expected = Rotation.from_rotvec(turns).inv().apply(acc + 0.07 * np.stack([y, -x, 0.0 * x], axis=1))
    wrong, change = np.asarray(imu.acc) - expected, expected - acc
    np.testing.assert_array_less(wrong[late].std(axis=0), 0.15 * np.linalg.norm(change[late].std(axis=0)))


@pytest.mark.parametrize("rate", [100.0, 200.0])
def test_jolts_make_a_sensor_vibrate_about_its_place_and_not_at_rest(rate):
    time, gyr, acc, imu, late, jolt = shaken(rate, ImuErrors(acc_jolt=1.3))
    np.testing.assert_allclose(imu.gyr, gyr, rtol=0, atol=1e-9)
    wrong = np.asarray(imu.acc) - acc
    # the derivative of white noise after a low-pass at 30 Hz, less what the sampling rate does not show
    answer = lfilter(*butter(2, 30.0, fs=rate), np.arange(400) == 0)
    shown = np.sqrt(np.sum(np.diff(answer, prepend=0.0) ** 2) * rate**3 * np.sqrt(8.0) / (2.0 * np.pi * 30.0) ** 3)
    assert 0.3 < shown < 0.8
    np.testing.assert_allclose(wrong[late].std(axis=0), 1.3 * jolt * shown, rtol=0.05)
    assert np.abs(wrong[time < 2.0]).max() < 1e-4
    # a vibration goes back and forth: over a minute it adds no more to the velocity than over a second
    velocity = np.cumsum(wrong[late], axis=0) / rate
    second = velocity[: int(rate)].std(axis=0)
    np.testing.assert_array_less(velocity.std(axis=0), 2.0 * second)


# --- what JAX asks ---

SMOOTH = ImuErrors(
    gyr_noise=0.01, gyr_bias=0.05, gyr_drift=0.01, gyr_scale=0.02, gyr_bandwidth=20.0, acc_noise=0.02, acc_bias=0.1,
    acc_drift=0.03, acc_scale=0.02, acc_bandwidth=15.0, mounting=0.1, mounting_x=0.2, mounting_y=-0.4, mounting_z=0.3,
    sway=0.05, sway_arm=0.06, acc_jolt=0.5,
)  # fmt: skip


def total(errors):
    imu = measure(KEY, TIME[:60], GYR[:60], ACC[:60], errors)
    return jnp.sum(jnp.sin(imu.gyr)) + jnp.sum(jnp.sin(0.3 * imu.acc))


sloped = jax.jit(jax.value_and_grad(total))


def with_gradient(errors):
    return jax.tree.map(np.asarray, sloped(jax.tree.map(np.asarray, errors)))


def test_gradients_equal_finite_differences():
    gradient = with_gradient(SMOOTH)[1]
    for name in (name for name in ImuErrors._fields if getattr(SMOOTH, name) != getattr(IDEAL, name)):
        at = getattr(SMOOTH, name)
        h = 1e-5 * max(1.0, abs(at))
        ahead, behind = (with_gradient(SMOOTH._replace(**{name: at + side}))[0] for side in (h, -h))
        expected = float(ahead - behind) / (2 * h)
        assert float(getattr(gradient, name)) == pytest.approx(expected, rel=1e-5, abs=1e-6), name


def test_gradients_are_finite_where_every_error_is_off():
    gradient = with_gradient(IDEAL)[1]
    for name, value in zip(ImuErrors._fields, gradient, strict=True):
        assert np.isfinite(value), name
    assert gradient.acc_bias != 0.0


@pytest.mark.parametrize(
    "change, message",
    [
        ({"gyr_noise": -0.1}, r"ImuErrors\.gyr_noise must be finite and in \[0, inf\]; got -0\.1"),
        ({"acc_range": 0.0}, r"ImuErrors\.acc_range must be above 0; got 0"),
        ({"packet_loss": 1.5}, r"ImuErrors\.packet_loss must be finite and in \[0, 1\]; got 1\.5"),
        ({"gyr_bias": np.array([0.1, -0.2])}, r"ImuErrors\.gyr_bias must .*; got -0\.2"),
    ],
)
def test_errors_that_no_sensor_has_are_refused_by_name(change, message):
    with pytest.raises(ValueError, match=message):
        check_errors(IDEAL._replace(**change))


@pytest.mark.usefixtures("unchecked")
def test_errors_that_are_no_numbers_are_refused():
    with pytest.raises(TypeError, match=r"ImuErrors\.acc_bias must be a number; got 'small'"):
        check_errors(IDEAL._replace(acc_bias="small"))
    check_errors(SMOOTH)
    check_errors(SMOOTH._replace(gyr_noise=np.array([0.1, 0.0]), mounting_x=-3.0))
