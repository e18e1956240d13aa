"""Replayed motion capture: analytic motions come back, gaps are masked, and a real walk feels like its sensors."""

import itertools

import numpy as np
import pytest

from jgait.geometry.vectors import GRAVITY
from jgait.simulate import replay
from jgait.simulate.replay import JointCentres, LegCentres, PelvisMarkers
from jgait.types import SIDES

DEGREE = np.pi / 180.0
THIGH, SHANK = 0.42, 0.40
W = 2.0 * np.pi * 0.9  # strides per second
TIME = np.arange(601) / 100.0
INNER = slice(60, -60)  # away from the ends, where a spline knows one side only


# --- a walk in closed form, turning: every angle and place is a sum of sines ---


def facing(t):
    return 0.7 + 0.5 * np.sin(0.8 * t)


def angles(t, side):
    """Thigh, shank and foot from standing [rad], the lower end forward positive."""
    s = 1.0 if side == "right" else -1.0
    thigh = 0.1 + 0.4 * s * np.sin(W * t)
    shank = thigh - 0.5 - 0.3 * s * np.cos(W * t)
    return thigh, shank, 0.2 * s * np.cos(W * t + 0.3)


def angle_rates(t, side):
    s = 1.0 if side == "right" else -1.0
    thigh = 0.4 * s * W * np.cos(W * t)
    return thigh, thigh + 0.3 * s * W * np.sin(W * t), -0.2 * s * W * np.sin(W * t + 0.3)


def axes(t, angle):
    """(3, T, 3): a segment's x, y, z in the world, tilted in the sagittal plane, then turned with the body."""
    s, c, zero, one = np.sin(angle), np.cos(angle), np.zeros_like(t), np.ones_like(t)
    x, y, z = ([c, zero, s], [zero, one, zero], [-s, zero, c])
    sp, cp = np.sin(facing(t)), np.cos(facing(t))
    return np.stack([np.stack([cp * a - sp * b, sp * a + cp * b, c], axis=1) for a, b, c in (x, y, z)])


def inside(t, angle, x, y, z):
    return np.einsum("atk,a->tk", axes(t, angle), [x, y, z])


def places(t):
    """Name → (T, 3): joints, and `sensor_…` at the default places."""
    root = np.stack([1.1 * t + 0.02 * np.sin(2 * W * t), 0.03 * np.sin(W * t), 0.9 + 0.02 * np.cos(2 * W * t)], axis=1)
    out = {"sensor_pelvis": root + inside(t, 0.0 * t, -0.1, 0.0, 0.0)}
    for side, sign in (("right", -1.0), ("left", 1.0)):
        thigh, shank, foot = angles(t, side)
        hip = root + inside(t, 0.0 * t, 0.0, 0.09 * sign, 0.0)
        knee = hip + inside(t, thigh, 0.0, 0.0, -THIGH)
        ankle = knee + inside(t, shank, 0.0, 0.0, -SHANK)
        out |= {f"hip_{side}": hip, f"knee_{side}": knee, f"ankle_{side}": ankle}
        out[f"heel_{side}"] = ankle + inside(t, foot, -0.05, 0.0, -0.06)
        out[f"toe_{side}"] = ankle + inside(t, foot, 0.15, 0.0, -0.06)
        out[f"sensor_thigh_{side}"] = hip + inside(t, thigh, 0.0, 0.0, -0.5 * THIGH)
        out[f"sensor_shank_{side}"] = knee + inside(t, shank, 0.0, 0.0, -0.5 * SHANK)
        out[f"sensor_ankle_{side}"] = knee + inside(t, shank, 0.0, 0.0, -0.9 * SHANK)
        out[f"sensor_foot_{side}"] = ankle + inside(t, foot, 0.05, 0.0, -0.01)
    return out


def centres(t, change=lambda name, values: values):
    at = places(t)
    legs = {
        side: LegCentres(*(change(f"{j}_{side}", at[f"{j}_{side}"].copy()) for j in LegCentres._fields))
        for side in SIDES
    }
    return JointCentres(t, **legs)


def tilt(placement, t, function=angles):
    part, _, side = placement.partition("_")
    if part == "pelvis":
        return 0.0 * t
    return function(t, side)[{"thigh": 0, "shank": 1, "ankle": 1, "foot": 2}[part]]


def felt(placement, t):
    """Exact angular rate; specific force by a difference formula of fourth order of the place in closed form."""
    angle, h = tilt(placement, t), 2e-3
    turn = 0.4 * np.cos(0.8 * t)
    gyr = np.stack([turn * np.sin(angle), -tilt(placement, t, angle_rates), turn * np.cos(angle)], axis=1)
    p = [places(t + k * h)[f"sensor_{placement}"] for k in range(-2, 3)]
    force = (-p[0] + 16 * p[1] - 30 * p[2] + 16 * p[3] - p[4]) / (12 * h * h) + [0.0, 0.0, GRAVITY]
    return gyr, np.einsum("atk,tk->ta", axes(t, angle), force)


def worst(recording, end=6.0):
    """Largest difference from the exact signals away from the ends: rad/s, m/s²."""
    gyr, acc = 0.0, 0.0
    for placement, imu in recording.sensors.items():
        true = felt(placement, imu.time)
        keep = (imu.time > 0.6) & (imu.time < end - 0.6) & imu.mask
        gyr = max(gyr, np.abs(imu.gyr - true[0])[keep].max())
        acc = max(acc, np.abs(imu.acc - true[1])[keep].max())
    return gyr, acc


@pytest.fixture(scope="module")
def walked():
    return replay.replay(centres(TIME), 100.0)


# --- the signals are the exact ones ---


def test_signals_are_those_of_the_motion_in_closed_form(walked):
    recording, _ = walked
    assert set(recording.sensors) == {
        "pelvis",
        *(f"{p}_{s}" for p in ("thigh", "shank", "ankle", "foot") for s in SIDES),
    }
    gyr, acc = worst(recording)
    # A cut-off of 10 Hz takes (1.8 / 10)⁶ = 3e-5 of the fastest sine in the motion.
    assert gyr < 1e-4
    assert acc < 1e-3


def test_the_error_falls_with_the_rate():
    errors = []
    for rate in (25.0, 50.0, 100.0):
        points = centres(np.arange(int(6 * rate) + 1) / rate)
        errors.append(worst(replay.replay(points, 100.0, cutoff_hz=rate / 5.0)[0]))
    for coarse, fine in itertools.pairwise(errors):
        # The cut-off doubles with the rate: 2⁶ = 64.
        assert coarse[0] > 40.0 * fine[0]
        assert coarse[1] > 40.0 * fine[1]


def test_any_rate_can_be_had():
    # As many samples as the other walks have, whose programs then serve.
    recording, truth = replay.replay(centres(TIME[:181]), 1000.0 / 3.0, placements=["shank_left"])
    assert len(truth.time) == 601
    assert truth.time[1] - truth.time[0] == pytest.approx(0.003)
    gyr, acc = worst(recording, 1.8)
    assert gyr < 1e-4
    assert acc < 1e-3


def test_truth_is_the_angles_and_the_path(walked):
    _, truth = walked
    at = places(TIME)
    heading = truth.diagnostics["heading"]
    for side in SIDES:
        leg = getattr(truth.legs, side)
        thigh, shank, _ = angles(TIME, side)
        np.testing.assert_allclose(leg.hip_angle[INNER], thigh[INNER], atol=1e-5)
        np.testing.assert_allclose(leg.knee_angle[INNER], (thigh - shank)[INNER], atol=1e-5)
        np.testing.assert_allclose(leg.y, (at[f"ankle_{side}"] - at[f"hip_{side}"])[:, 2], atol=1e-3)
        assert truth.diagnostics[f"thigh_length_{side}"] == pytest.approx(THIGH, abs=1e-4)
        assert truth.diagnostics[f"shank_length_{side}"] == pytest.approx(SHANK, abs=1e-4)
    np.testing.assert_allclose(heading[INNER], facing(TIME)[INNER], atol=3e-3)
    assert truth.distance[-1] == pytest.approx(6.6, rel=0.01)
    assert truth.valid.all()


def test_turning_the_laboratory_changes_no_sensor(walked):
    s, c = np.sin(2.0), np.cos(2.0)
    turned = replay.replay(centres(TIME, lambda _, p: p @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])), 100.0)
    for placement, imu in walked[0].sensors.items():
        np.testing.assert_allclose(turned[0].sensors[placement].gyr, imu.gyr, atol=1e-8)
        np.testing.assert_allclose(turned[0].sensors[placement].acc, imu.acc, atol=1e-7)


def test_axes_stay_orthonormal_and_their_rates_have_the_norm_of_the_angular_rate(walked):
    body = replay.body_motion(centres(TIME), TIME)
    for segment, frame in body.motion.pose._asdict().items():
        a = np.stack([np.stack(axis, axis=1) for axis in frame[1:]])
        np.testing.assert_allclose(np.einsum("atk,btk->tab", a, a), np.tile(np.eye(3), (601, 1, 1)), atol=1e-12)
        np.testing.assert_allclose(np.linalg.det(a.transpose(1, 0, 2)), 1.0, atol=1e-12)
        rate = getattr(body.motion.rate, segment)
        squared = sum(np.sum(np.stack(axis) ** 2, axis=0) for axis in rate[1:]) / 2.0
        gyr = walked[0].sensors[segment].gyr
        np.testing.assert_allclose(np.sqrt(squared), np.linalg.norm(gyr, axis=1), atol=1e-10)


def test_standing_reads_gravity_along_the_leg_and_no_rate():
    stand = {}
    for side, y in (("right", -0.1), ("left", 0.1)):
        rows = [(0, y, 0.9), (0, y, 0.48), (0, y, 0.08), (-0.05, y, 0.02), (0.15, y, 0.02)]
        stand[side] = LegCentres(*(np.tile(np.asarray(row, float), (601, 1)) for row in rows))
    recording, truth = replay.replay(JointCentres(TIME, **stand), 100.0)
    for imu in recording.sensors.values():
        np.testing.assert_allclose(imu.gyr, 0.0, atol=1e-9)
        np.testing.assert_allclose(imu.acc, np.tile([0.0, 0.0, GRAVITY], (601, 1)), atol=1e-7)
    np.testing.assert_allclose(truth.distance, 0.0, atol=1e-9)


# --- what says where a body faces ---


def test_one_leg_with_a_heading_is_that_leg_of_two():
    points = centres(TIME)
    one = JointCentres(TIME, left=points.left, heading=facing(TIME))
    recording, truth = replay.replay(one, 100.0)
    assert "pelvis" not in recording.sensors
    assert truth.legs.right is None
    gyr, acc = worst(recording)
    assert gyr < 1e-4
    assert acc < 1e-3
    np.testing.assert_allclose(truth.legs.left.hip_angle[INNER], angles(TIME, "left")[0][INNER], atol=1e-4)


def test_markers_tilt_the_pelvis():
    pitch = 0.1 * np.sin(W * TIME)
    points = centres(TIME)
    root = (points.right.hip + points.left.hip) / 2.0
    corners = {
        "front_right": (0.1, -0.12),
        "front_left": (0.1, 0.12),
        "back_right": (-0.1, -0.05),
        "back_left": (-0.1, 0.05),
    }
    markers = {name: root + inside(TIME, pitch, x, y, 0.05) for name, (x, y) in corners.items()}
    recording, _ = replay.replay(points._replace(pelvis=PelvisMarkers(**markers)), 100.0, placements=["pelvis"])
    expected = -0.1 * W * np.cos(W * TIME)
    np.testing.assert_allclose(recording.sensors["pelvis"].gyr[INNER, 1], expected[INNER], atol=1e-3)


def test_a_toe_turned_out_does_not_turn_the_shank():
    yaw = 12.0 * DEGREE

    def out(name, values):
        if name not in ("heel_right", "toe_right"):
            return values
        foot = angles(TIME, "right")[2]
        x, z = (-0.05, -0.06) if name == "heel_right" else (0.15, -0.06)
        ankle = places(TIME)["ankle_right"]
        return ankle + inside(TIME, foot, x * np.cos(yaw), -x * np.sin(yaw), z)

    recording, _ = replay.replay(centres(TIME, out), 100.0, placements=["shank_right"])
    true, _ = felt("shank_right", TIME)
    # Pitching a foot that is turned out turns it about the shank a little.
    error = np.sqrt(np.mean((recording.sensors["shank_right"].gyr[:, 1] - true[:, 1])[INNER] ** 2))
    assert error < 0.02 * np.sqrt(np.mean(true[INNER, 1] ** 2))


# --- noise ---


def acceleration_noise(noise, rate, cutoff):
    """σ_a of the second derivative: σ_a² = σ² / f_s ∫ (2πν)⁴ / (1 + (ν/f)⁶)² dν = σ² / f_s (2π)⁴ f⁵ π / 9."""
    return noise * np.sqrt((2.0 * np.pi) ** 4 * cutoff**5 * np.pi / 9.0 / rate)


def test_noise_of_the_second_derivative_is_as_predicted():
    rng = np.random.default_rng(0)
    time = np.arange(4000) / 100.0
    for cutoff in (5.0, 10.0):
        spline = replay.smooth(time, 1e-3 * rng.standard_normal((4000, 3)), cutoff_hz=cutoff)
        measured = replay.evaluate(spline, time[200:-200]).acceleration.std()
        # About 2 f T = 400 independent values a coordinate: 6σ of a standard deviation are 12 %.
        assert measured == pytest.approx(acceleration_noise(1e-3, 100.0, cutoff), rel=0.12)


def test_the_gain_is_half_at_the_cut_off():
    time = np.arange(2000) / 100.0
    wave = np.stack([np.sin(2 * np.pi * f * time) for f in (2.5, 5.0, 10.0)], axis=1)
    inner = slice(400, -400)
    smoothed = replay.evaluate(replay.smooth(time, wave, cutoff_hz=5.0), time).pose
    gain = np.sum(smoothed[inner] * wave[inner], axis=0) / np.sum(wave[inner] ** 2, axis=0)
    np.testing.assert_allclose(gain, 1.0 / (1.0 + np.array([0.5, 1.0, 2.0]) ** 6), atol=1e-3)


def test_known_noise_chooses_the_cut_off_and_bounds_the_error():
    rng = np.random.default_rng(1)
    noisy = centres(TIME, lambda _, values: values + 1e-3 * rng.standard_normal(values.shape))
    fixed, truth = replay.replay(noisy, 100.0)
    chosen, tuned = replay.replay(noisy, 100.0, noise=1e-3)

    def rms(recording):
        return {p: np.sqrt(np.mean((imu.acc - felt(p, TIME)[1])[INNER] ** 2)) for p, imu in recording.sensors.items()}

    predicted = acceleration_noise(1e-3, 100.0, 10.0)
    for placement, error in rms(fixed).items():
        # Sensors between two joints average their noise; the foot's axes, 0.2 m long, add g times their tilt.
        assert 0.4 * predicted < error < 2.0 * predicted, placement
    for placement, error in rms(chosen).items():
        assert error < 0.8 * rms(fixed)[placement], placement
        assert error < 0.6, placement
    assert tuned.diagnostics["residual_knee_left"] == pytest.approx(1e-3, rel=0.01)
    assert truth.diagnostics["cutoff_hz_knee_left"] == 10.0
    assert 2.0 < tuned.diagnostics["cutoff_hz_knee_left"] < 10.0


# --- gaps ---


def test_a_short_gap_is_bridged_and_a_long_one_masked(walked):
    def hidden(name, values):
        if name == "knee_right":
            values[100:108] = np.nan
        if name == "knee_left":
            values[300:360] = np.nan
        if name == "hip_left":
            values[-30:, 2] = np.nan
        return values

    recording, truth = replay.replay(centres(TIME, hidden), 100.0)
    sensors = recording.sensors
    lost = np.zeros(601, bool)
    lost[-30:] = True
    for placement in ("pelvis", "thigh_right"):  # all that hangs on the line of the hips
        np.testing.assert_array_equal(sensors[placement].mask, ~lost)
    np.testing.assert_array_equal(sensors["shank_right"].mask, True)
    np.testing.assert_array_equal(sensors["foot_left"].mask, True)
    lost[300:360] = True
    np.testing.assert_array_equal(sensors["thigh_left"].mask, ~lost)
    np.testing.assert_array_equal(truth.valid, ~lost)
    assert not sensors["thigh_left"].acc[~sensors["thigh_left"].mask].any()
    for placement, imu in sensors.items():
        assert np.isfinite(imu.gyr).all() and np.isfinite(imu.acc).all()
        away = imu.mask.copy()  # of the gaps' edges, where the spline knows one side only
        away[250:410] = away[:60] = away[-90:] = False
        np.testing.assert_allclose(imu.gyr[away], walked[0].sensors[placement].gyr[away], atol=0.02)
        np.testing.assert_allclose(imu.acc[away], walked[0].sensors[placement].acc[away], atol=0.5)


def test_longest_gap_that_is_bridged_can_be_chosen():
    values = np.stack([np.sin(TIME)] * 3, axis=1)
    values[200:230] = np.nan
    for max_gap, expected in ((0.1, False), (0.31, True)):
        spline = replay.smooth(TIME, values, max_gap=max_gap)
        assert replay.covered(spline, TIME[215:216])[0] == expected
        assert replay.covered(spline, TIME[[199, 230]]).all()
    np.testing.assert_allclose(replay.evaluate(spline, TIME).pose[:, 0], np.sin(TIME), atol=1e-4)


# --- sensors ---


def test_places():
    points = centres(TIME)
    body = replay.body_motion(points, TIME)
    np.testing.assert_allclose(replay.mount(body, "pelvis"), [-0.1, 0.0, 0.0])
    np.testing.assert_allclose(replay.mount(body, "thigh_left"), [0.0, 0.0, -0.5 * THIGH], atol=1e-4)
    np.testing.assert_allclose(replay.mount(body, "ankle_left"), [0.0, 0.0, -0.9 * SHANK], atol=1e-4)
    np.testing.assert_allclose(replay.mount(body, "foot_left"), [0.05, 0.0, -0.01], atol=1e-4)


# --- what cannot be used is refused ---


def shortened(points):
    return points._replace(right=points.right._replace(knee=points.right.knee[:-1]))


@pytest.mark.parametrize(
    "change, arguments, message",
    [
        (shortened, {}, r"knee_right must be \(601, 3\).*got \(600, 3\)"),
        (lambda p: p._replace(right=None, left=None), {}, "at least one leg"),
        (lambda p: p._replace(right=None), {}, "give JointCentres.heading or pelvis markers"),
        (lambda p: p._replace(heading=np.zeros(5)), {}, r"heading must be \(601,\); got \(5,\)"),
        (lambda p: p._replace(time=TIME[::-1]), {}, "strictly increasing"),
        (lambda p: p._replace(time=TIME[:, None]), {}, r"time must be \(T,\)"),
        (lambda p: p._replace(left=p.left._replace(hip=np.full((601, 3), np.nan))), {}, "6 finite rows; there are 0"),
        (lambda p: p, {"placements": ["wrist_left"]}, "placed at pelvis, .*got wrist_left"),
        (lambda p: p, {"placements": []}, "got none"),
        (lambda p: p, {"cutoff_hz": 60.0}, r"cutoff_hz must lie in \[0.5, 50\]"),
        (lambda p: p, {"noise": -1.0}, "noise must be positive"),
        (lambda p: p, {"rate_hz": 0.0}, "rate_hz must be positive"),
        (lambda p: p, {"rate_hz": 1.0}, "7 samples; at least 10"),
    ],
)
def test_bad_input_is_refused(change, arguments, message):
    with pytest.raises(ValueError, match=message):
        replay.replay(change(centres(TIME)), **{"rate_hz": 100.0, **arguments})


def test_times_outside_and_walks_without_joints_are_refused(data):
    with pytest.raises(ValueError, match="within"):
        replay.body_motion(centres(TIME), TIME + 1.0)
    with pytest.raises(ValueError, match="joint_centres"):
        replay.from_walk(data("neura_sparse")[0]._replace(info={}))


# --- a real walk ---


@pytest.fixture(scope="module")
def real(data):
    walk = data("neura_sparse")[0]
    return walk, *replay.replay(replay.from_walk(walk), 100.0)


def pairs(real, placement, window="straight"):
    """Replayed and worn gyroscope and accelerometer on the straight parts."""
    walk, recording, _ = real
    keep = np.zeros(len(recording.sensors[placement].time), bool)
    for name, (start, end) in walk.info["windows"].items():
        if name.startswith(window):
            keep[start:end] = True
    worn, ideal = walk.recording.sensors[placement], recording.sensors[placement]
    keep &= worn.mask & ideal.mask
    return ideal.gyr[keep], worn.gyr[keep], ideal.acc[keep], worn.acc[keep]


@pytest.mark.parametrize(
    "part, least", [("thigh", 0.93), ("shank", 0.99), ("ankle", 0.99), ("foot", 0.98)]
)  # measured: 0.941, 0.994, 0.995, 0.990
def test_sagittal_rates_are_those_of_the_worn_gyroscopes(real, part, least):
    for side in SIDES:
        ideal, worn, _, _ = pairs(real, f"{part}_{side}")
        # How the sensor was put on is unknown: the direction in it that is the leg's axis is fitted.
        axis, *_ = np.linalg.lstsq(worn, ideal[:, 1], rcond=None)
        assert np.corrcoef(ideal[:, 1], worn @ axis)[0, 1] > least
        assert np.linalg.norm(axis) == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize("part", ["shank", "ankle", "foot"])
def test_rates_have_the_size_of_the_worn_ones(real, part):
    for side in SIDES:
        ideal, worn, _, _ = pairs(real, f"{part}_{side}", "whole")
        ideal, worn = (np.linalg.norm(gyr, axis=1) for gyr in (ideal, worn))
        assert np.corrcoef(ideal, worn)[0, 1] > 0.94
        assert ideal.mean() == pytest.approx(worn.mean(), rel=0.15)


@pytest.mark.parametrize("part, least", [("shank", 0.5), ("ankle", 0.8), ("foot", 0.6)])
def test_accelerations_have_the_size_of_the_worn_ones(real, part, least):
    for side in SIDES:
        _, _, ideal, worn = pairs(real, f"{part}_{side}", "whole")
        ideal, worn = (np.linalg.norm(acc, axis=1) for acc in (ideal, worn))
        assert np.corrcoef(ideal, worn)[0, 1] > least
        # Impacts are faster than the markers' low-pass, so the replayed ones are the weaker.
        assert 0.6 < ideal.std() / worn.std() < 1.0
        assert ideal.mean() == pytest.approx(worn.mean(), rel=0.1)


def test_standing_still_reads_gravity(real):
    walk, recording, _ = real
    stand = slice(*walk.info["windows"]["standing"])
    for imu in recording.sensors.values():
        assert np.linalg.norm(imu.acc[stand], axis=1).mean() == pytest.approx(GRAVITY, abs=0.02)
        assert np.abs(imu.gyr[stand]).mean() < 0.05


def test_truth_is_the_reference_of_the_data_set(real):
    walk, _, truth = real
    for side in SIDES:
        mine, reference = getattr(truth.legs, side), getattr(walk.reference.legs, side)
        np.testing.assert_allclose(mine.hip_angle, reference.hip_angle, atol=0.05 * DEGREE)
        np.testing.assert_allclose(mine.knee_angle, reference.knee_angle, atol=0.05 * DEGREE)
        np.testing.assert_allclose(mine.x, reference.x, atol=2e-4)
        np.testing.assert_allclose(mine.y, reference.y, atol=2e-4)
    assert truth.distance[-1] == pytest.approx(walk.reference.distance[-1], rel=0.01)
    assert truth.valid.all()
