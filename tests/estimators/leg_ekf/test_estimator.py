"""The leg estimator: accuracy, online form, invariances, limits, and the paper's worked equations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made.estimators import altered, only, part, times, without
from made.notes import texts
from made.trunk import rotation

from experiments.common import protocols
from jgait.estimators import leg_ekf, programs
from jgait.estimators.interface import pad
from jgait.estimators.leg_ekf import DEFAULT, PAPER, BySide, LegParams
from jgait.estimators.leg_ekf import model as leg_model
from jgait.estimators.leg_ekf.estimator import walked
from jgait.estimators.leg_ekf.inputs import LegInputs
from jgait.simulate.sensors import IDEAL
from jgait.types import SIDES, Recording, RecordingError

RATE = 50.0


def run(p, inputs: LegInputs, options):
    """The estimate by the program of `estimate`, with its padding, as NumPy arrays."""
    padded = pad(inputs, programs.bucket(inputs.time.size))
    return jax.tree.map(np.asarray, programs.compiled(leg_ekf.run)(p, padded, options=options))


@pytest.fixture(scope="module")
def walk():
    """One simulated person with ideal sensors."""
    (walked,) = protocols.bennett(jax.random.key(3), errors=IDEAL, rate=RATE)
    return walked.recording, walked.truth.estimate


@pytest.fixture(scope="module")
def noisy():
    """Another person with an IDG-300-like gyroscope."""
    (walked,) = protocols.bennett(jax.random.key(4), rate=RATE)
    return walked.recording, walked.truth.estimate


def parameters(truth) -> LegParams:
    thigh, shank = float(truth.diagnostics["thigh_length"]), float(truth.diagnostics["shank_length"])
    return LegParams(thigh_length=BySide(thigh, thigh), shank_length=BySide(shank, shank))


@pytest.fixture(scope="module")
def plain(noisy):
    return leg_ekf.estimate(parameters(noisy[1]), noisy[0])


@pytest.fixture(scope="module")
def ideal(walk):
    return leg_ekf.estimate(parameters(walk[1]), walk[0])


def prepared(recording: Recording) -> LegInputs:
    return leg_ekf.prepared(recording, DEFAULT).inputs


def right_leg(recording: Recording) -> Recording:
    """The sensors of the right leg: a program of one leg compiles in half the time."""
    return only(recording, "thigh_right", "shank_right")


def rotated(recording: Recording, seed: int) -> Recording:
    """Every sensor mounted in another random attitude."""
    for number, name in enumerate(recording.sensors):
        turn = rotation(seed + number)
        recording = altered(recording, name, gyr=lambda v, turn=turn: v @ turn, acc=lambda v, turn=turn: v @ turn)
    return recording


def worst(ours, theirs, field: str) -> float:
    """Largest difference relative to standing, over both legs."""
    out = 0.0
    for side in SIDES:
        a, b = (
            np.asarray(getattr(getattr(ours.legs, side), field)),
            np.asarray(getattr(getattr(theirs.legs, side), field)),
        )
        b = np.interp(ours.time, theirs.time, b)
        out = max(out, np.max(np.abs((a - a[:50].mean()) - (b - b[:50].mean()))))
    return float(out)


def test_ideal_sensors_give_the_true_angles_and_foot_path(walk):
    recording, truth = walk
    p = parameters(truth)
    standing = (
        [float(np.asarray(leg.hip_angle)[0]) for leg in truth.legs],
        [float(np.asarray(leg.knee_angle)[0]) for leg in truth.legs],
    )
    p = p._replace(standing_hip=BySide(*standing[0]), standing_knee=BySide(*standing[1]))
    result = leg_ekf.estimate(p, recording)
    # What is left is the push at the start, which the accelerometer takes for a lean of the segment.
    assert np.degrees(worst(result, truth, "hip_angle")) < 2.5
    assert np.degrees(worst(result, truth, "knee_angle")) < 2.5
    assert worst(result, truth, "x") < 0.04
    assert worst(result, truth, "y") < 0.02
    assert bool(np.all(result.valid))


def test_deviations_contain_the_standing_pose_and_grow_with_the_angle(walk, ideal):
    recording, truth = walk
    p = parameters(truth)
    sure = leg_ekf.estimate(p._replace(standing_hip_sd=1e-6, standing_knee_sd=1e-6), recording)
    stated, rest, zero = ideal.stddev.right, sure.stddev.right, ideal.diagnostics["zero_stddev_right"]
    assert zero[0] < p.standing_hip_sd and zero[1] < p.standing_knee_sd  # as walking states the pose, too
    for joint, pose in zip(("hip_angle", "knee_angle"), np.asarray(zero), strict=True):
        whole, moving = np.asarray(getattr(stated, joint)), np.asarray(getattr(rest, joint))
        np.testing.assert_allclose(whole**2 - moving**2, pose**2, rtol=1e-3)
        assert moving.max() > 1.5 * moving[:50].mean()
    # an error of the hip turns the whole leg: of the standing foot, which is below the hip, mostly forward
    length = float(p.thigh_length.right + p.shank_length.right)
    assert np.asarray(stated.x)[:50].mean() > 0.9 * zero[0] * length


def squeezed(acc):
    return acc * np.array([0.2, 0.2, 1.0])


def shaken(acc):
    return acc * np.where(np.arange(len(acc)) // 20 % 2, 1.5, 0.6)[:, None]


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"acc": squeezed}, "shanks_apart"),
        ({"acc": shaken}, "strides_doubtful"),
        ({"gyr": lambda gyr: np.clip(gyr, -4.4, 4.4)}, "signal_clipped"),
    ],
    ids=["other distance", "other stances", "clipped"],
)
def test_a_shank_that_cannot_be_right_is_noted(walk, ideal, change, code):
    recording, truth = walk
    wrong = leg_ekf.estimate(parameters(truth), altered(recording, "shank_left", **change))
    for found, damaged in ((ideal.diagnostics, False), (wrong.diagnostics, True)):
        noted = [note.values.get("placement", "") for note in found["notes"] if note.code == code]
        assert noted == (([""] if code == "shanks_apart" else ["shank_left"]) if damaged else [])
        if code == "shanks_apart":
            right, left = (float(found[f"shank_distance_{side}"]) for side in SIDES)
            assert (abs(right - left) > 1.6) == damaged


def test_distance_with_one_leg_and_by_every_read_out(walk):
    recording, truth = walk
    p, true = parameters(truth), float(np.asarray(truth.distance)[-1])
    result = leg_ekf.estimate(p, right_leg(recording))
    inputs, way = prepared(right_leg(recording)), jax.jit(walked, static_argnums=3)
    found = {  # of the same trajectory of the leg
        how: float(way(p, result.legs, inputs, DEFAULT._replace(distance=how))[0][-1])
        for how in ("strapdown", "stance", "accumulate", "forward")
    }
    assert found["strapdown"] == pytest.approx(float(result.distance[-1]), rel=1e-9)
    assert abs(found["strapdown"] / true - 1.0) < 0.05
    assert abs(found["stance"] / true - 1.0) < 0.25
    assert abs(found["accumulate"] / true - 1.0) < 0.25
    assert 0.5 < found["forward"] / true < 0.75  # the hip's own way is left out
    with pytest.raises(ValueError, match="distance must be one of strapdown, stance, accumulate, forward; got 'steps'"):
        leg_ekf.estimate(parameters(truth), right_leg(recording), DEFAULT._replace(distance="steps"))


def test_turning_the_sensor_with_its_mount_changes_nothing(noisy, plain):
    turned = leg_ekf.estimate(parameters(noisy[1]), rotated(noisy[0], 1))
    for a, b in zip(jax.tree.leaves(plain.legs), jax.tree.leaves(turned.legs), strict=True):
        np.testing.assert_allclose(np.asarray(a), np.asarray(b), atol=1e-6)
    # The axes of the shank start from the median of each component: they follow the mount to within 0.1 degrees.
    assert float(plain.distance[-1]) == pytest.approx(float(turned.distance[-1]), rel=1e-3)


@pytest.mark.release
def test_paper_pipeline_runs_at_50_hz_and_drifts_more(noisy, plain):
    recording, truth = noisy
    paper = leg_ekf.estimate(parameters(truth), recording, PAPER)
    assert worst(plain, truth, "hip_angle") < worst(paper, truth, "hip_angle")
    assert 1.0 / np.median(np.diff(paper.time)) == pytest.approx(50.0)


def test_the_transition_is_equation_5_and_its_jacobian_equation_6():
    p = leg_model.LegModelParams(0.4, 0.5, 1e-6, 1.0, 1e-12, 1e-4, 1e-4, 1e-6)
    state = leg_model.LegState(0.1, -0.8, -1.4, 2.0, -0.3, -1.5, 0.01, 0.02)
    control, dt = leg_model.LegControl(1.0, 1.0), 0.02
    a, b = 0.4 * np.sin(-1.4), 0.5 * np.sin(-1.7)
    c, d = 0.4 * np.cos(-1.4), 0.5 * np.cos(-1.7)
    moved = leg_model.transition(p, state, control, dt)
    assert float(moved.x) == pytest.approx(0.1 + dt * (-a * 2.0 - b * (2.0 - 1.5)))
    assert float(moved.y) == pytest.approx(-0.8 + dt * (c * 2.0 + d * (2.0 - 1.5)))
    state = leg_model.LegState(*(jnp.asarray(v) for v in state))
    jacobian = jax.jacfwd(lambda s: leg_model.transition(p, s, control, dt))(state)
    assert float(jacobian.x.thigh_rate) == pytest.approx(dt * (-a - b))  # A
    assert float(jacobian.x.knee_rate) == pytest.approx(dt * -b)  # B
    assert float(jacobian.y.thigh_rate) == pytest.approx(dt * (c + d))  # C, corrected
    assert float(jacobian.y.knee_rate) == pytest.approx(dt * d)  # D
    noise = leg_model.transition_noise(p, state, control, dt)
    assert float(noise["thigh_angle", "thigh_rate"]) == pytest.approx(dt**2 / 2)
    assert float(noise["knee_angle", "knee_angle"]) == pytest.approx(dt**3 / 3)


REFUSED = {
    "another place": (
        lambda r: r._replace(sensors={"waist": r.sensors["thigh_right"]}),
        r"leg_ekf needs 'thigh_right' and 'shank_right'.*\['waist'\]",
    ),
    "no shank": (lambda r: only(r, "thigh_left"), r"leg_ekf needs 'shank_left'; the recording has \['thigh_left'\]"),
    "never still": (
        lambda r: altered(r, gyr=lambda v: v + np.random.default_rng(0).normal(size=v.shape), acc=lambda v: None),
        "needs 0.5 s of quiet standing .* without accelerometers",
    ),
    "never walking": (
        lambda r: altered(r, gyr=lambda v: 0.01 * v), "found no walking: .* is the gyroscope in rad/s",
    ),
    "clocks": (
        lambda r: altered(r, "shank_left", time=lambda v: v + 1.0), "thigh and shank on one clock; 'shank_left'",
    ),
    "short": (lambda r: part(r, slice(2)), "has 2 samples"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_estimated_is_refused_with_what_was_expected_and_what_came(noisy, name):
    changed, message = REFUSED[name]
    with pytest.raises(RecordingError, match=message):
        leg_ekf.estimate(LegParams(), changed(noisy[0]))


def test_a_rate_above_the_recording_s_is_refused(noisy):
    with pytest.raises(RecordingError, match="rate_hz=200 is above the recording's rate of 50.0 Hz"):
        leg_ekf.estimate(LegParams(), noisy[0], DEFAULT._replace(rate_hz=200.0))


@pytest.mark.release
def test_stated_deviations_survive_float32(data):
    """On a real walk smoothing leaves nothing of some covariances in float32; the filter's stand for them."""
    recording = data("neura_sparse")[0].recording
    inputs = leg_ekf.prepared(recording).inputs
    single = jax.tree.map(lambda v: v.astype(np.float32) if v.dtype == np.float64 else v, inputs)
    p32 = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), LegParams())
    fine = run(LegParams(), inputs, DEFAULT)
    coarse = jax.jit(leg_ekf.run, static_argnames="options")
    for side, leg in zip(SIDES, fine.stddev, strict=True):  # each as a right leg: a program half as large
        alone = single._replace(right=getattr(single, side), left=None)
        other = coarse(p32, alone, DEFAULT._replace(distance="stance")).stddev.right
        for ours, theirs in zip((v[: inputs.time.size] for v in leg), other, strict=True):
            assert np.isfinite(theirs).all()
            assert np.median(np.asarray(theirs) / np.asarray(ours)) == pytest.approx(1.0, abs=0.15)


def test_of_long_gaps_nothing_is_stated_and_one_leg_is_noted(walk):
    recording, rate = walk[0], walk[0].sampling_rate_hz
    begin = len(times(recording)) // 2
    lossy = without(recording, (begin - 0.5) / rate, 0.8, "shank_right")
    found = leg_ekf.prepared(without(lossy, begin / rate - 1.0, 0.1, "shank_right"))
    np.testing.assert_array_equal(np.flatnonzero(~found.inputs.valid), np.arange(begin, begin + round(0.8 * rate)))
    assert any(note.startswith("right: no angles are stated for 0.80 s from") for note in texts(found.notes))
    assert leg_ekf.prepared(recording).inputs.valid.all()

    three = only(recording, "thigh_right", "shank_right", "shank_left")
    alone = leg_ekf.prepared(three, DEFAULT._replace(distance="stance"))
    assert any(note.startswith("leg_ekf measures the right leg only: its own distance") for note in texts(alone.notes))
    assert "shank_left is left out, because it is worn without the thigh of that leg" in texts(alone.notes)
