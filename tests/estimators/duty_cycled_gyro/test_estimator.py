"""Leg angles while gyroscopes sleep: the truth, what is hidden, flags, energies, bad input, and what every one owes."""

import jax
import numpy as np
import pytest
from made.estimators import altered, hidden, part, times
from made.notes import texts

from experiments.common import protocols
from jgait import io, simulate
from jgait.duty_cycle import power
from jgait.duty_cycle.filling import FILLED, HELD, MEASURED
from jgait.duty_cycle.power import Schedule
from jgait.duty_cycle.recording import fill_recording, gyroscope_masks
from jgait.estimators import duty_cycled_gyro, leg_ekf
from jgait.estimators.duty_cycled_gyro import DEFAULT, DutyCycledOptions, DutyCycledParams
from jgait.simulate.sensors import IDEAL
from jgait.types import SIDES, RecordingError

RATE = 50.0
WARM = 6.0  # [s] some three of the five seconds of walking
SLEEPY = DutyCycledOptions(schedule=Schedule(2, 2, 0.25), warm_up=WARM)
P = DutyCycledParams()


@pytest.fixture(scope="module")
def walk():
    """Five seconds of walking with ideal sensors on both legs."""
    walked, _ = protocols.udaya_shankar(jax.random.key(0), 2, 5.0, placements=simulate.FOUR, errors=IDEAL)
    return walked.recording, walked.truth.estimate


@pytest.fixture(scope="module")
def always(walk):
    """One sample is hidden, so that the program is that of the others."""
    hidden = np.arange(walk[0].sensors["shank_left"].time.size) != 5
    return duty_cycled_gyro.estimate(P, walk[0], gyro_on={"shank_left": hidden})


@pytest.fixture(scope="module")
def sleepy(walk):
    return duty_cycled_gyro.estimate(P, walk[0], SLEEPY)


def rms_deg(ours, theirs, field, side, rows=slice(None)):
    a, b = (np.asarray(getattr(getattr(e.legs, side), field)) for e in (ours, theirs))
    b = np.interp(ours.time, theirs.time, b)
    return float(np.degrees(np.sqrt(np.mean(((a - a[:50].mean()) - (b - b[:50].mean()))[rows] ** 2))))


def test_clean_signals_give_the_true_angles(walk, always):
    truth = walk[1]
    for side in SIDES:
        # The simulated leg stands with bent joints, which is 0 to the sensors, and its pelvis lists a little.
        assert rms_deg(always, truth, "hip_angle", side) < 1.5
        assert rms_deg(always, truth, "knee_angle", side) < 1.5
    assert np.all(always.valid) and always.distance is None
    assert always.diagnostics["gyro_energy_saved"] == 0.0 or always.diagnostics["gyro_energy_saved"] < 1e-3


def test_gaps_are_filled_flagged_and_paid_for(walk, always, sleepy):
    told = sleepy.diagnostics
    used = gyroscope_masks(walk[0], ["shank_right", "thigh_right"], schedule=SLEEPY.schedule, warm_up=WARM)
    on = used["shank_right"].usable
    how = np.asarray(told["how_shank_right"])
    np.testing.assert_array_equal(how == MEASURED, on)
    assert np.mean(how[~on] == FILLED) > 0.8 and np.all(told["how_thigh_right"] == MEASURED)
    rate, true = (np.asarray(e.diagnostics["gyro_shank_right"]) for e in (sleepy, always))
    # The axis is told by what was on, and differs a little from that of all samples.
    np.testing.assert_allclose(rate[on], true[on], rtol=5e-3, atol=1e-5)
    off = ~on & (np.abs(true) > 0.05)
    assert np.sqrt(np.mean((rate - true)[off] ** 2) / np.mean(true[off] ** 2)) < 0.5
    for side in SIDES:
        assert rms_deg(sleepy, always, "hip_angle", side) < 0.1  # the thigh never slept
        # What a filled rate errs stays in the angle, of which its deviation tells.
        assert rms_deg(sleepy, always, "knee_angle", side, sleepy.valid) < 8.0
        error = np.asarray(getattr(sleepy.legs, side).knee_angle) - np.asarray(getattr(always.legs, side).knee_angle)
        late = sleepy.valid & (sleepy.time > WARM)
        assert late.sum() > 0.9 * np.sum(sleepy.time > WARM)
        stated = np.asarray(getattr(sleepy.stddev, side).knee_angle)
        assert np.sqrt(np.mean((error[late] / stated[late]) ** 2)) < 1.2
        wider = np.asarray(getattr(sleepy.stddev, side).knee_angle) / np.asarray(
            getattr(always.stddev, side).knee_angle
        )
        assert wider[off].mean() > 1.1
    # By hand: both shanks' gyroscopes slept, of four.
    powered, seconds = used["shank_right"].powered, on.size / RATE
    saved = 2.0 * (~powered).sum() / RATE / (4.0 * seconds)
    assert told["gyro_energy_saved"] == pytest.approx(saved)
    assert told["mean_power"] == pytest.approx(4.0 * (30e-3 * (1.0 - saved) + 2.7e-3))
    assert told["battery_life"] == pytest.approx(3600.0 / told["mean_power"])
    assert told["battery_life"] > told["battery_life_always_on"] == pytest.approx(3600.0 / (4.0 * 32.7e-3))
    assert told["schedule_saving"] == pytest.approx(power.saving(SLEEPY.schedule))
    assert told["latency"] == 0.0


def test_what_a_schedule_hides_is_looked_at_nowhere(walk, sleepy):
    recording = spoilt = walk[0]
    used = gyroscope_masks(recording, list(recording.sensors), schedule=SLEEPY.schedule, warm_up=WARM)
    for name, masks in used.items():
        spoilt = altered(spoilt, name, gyr=lambda gyr, on=masks.usable: np.where(on[:, None], gyr, 7.0))
    again = duty_cycled_gyro.estimate(P, spoilt, SLEEPY)
    jax.tree.map(np.testing.assert_array_equal, again.legs, sleepy.legs)
    one, other = (fill_recording(r, schedule=SLEEPY.schedule, warm_up=WARM) for r in (recording, spoilt))
    for name in recording.sensors:
        np.testing.assert_array_equal(one.sensors[name].gyr, other.sensors[name].gyr)


def test_before_two_strides_rates_are_held_and_flagged(walk, always):
    early = duty_cycled_gyro.estimate(P, walk[0], SLEEPY._replace(warm_up=3.8))
    how, rate = (np.asarray(early.diagnostics[f"{what}_shank_right"]) for what in ("how", "gyro"))
    held = np.flatnonzero(how == HELD)
    assert held.size and held[0] == np.flatnonzero(how != MEASURED)[0]
    assert rate[held[0]] == rate[held[0] - 1]
    held_notes = [note for note in early.diagnostics["notes"] if note.code == "rate_held"]
    (note,) = (note for note in held_notes if note.values["placement"] == "shank_right")
    assert note.values["begin_s"] == pytest.approx(3.8, abs=0.005)
    assert ", the first at 3.80 s and the last at " in note.text
    assert not early.valid[held].all() and not early.valid[held[0]]
    assert early.valid[: held[0]].all()
    # A leg does not turn over for it.
    assert max(np.max(np.abs(leg.knee_angle)) for leg in early.legs) < 2.0
    assert not any(note.code == "rate_held" for note in always.diagnostics["notes"])


def shank_only(recording):
    return recording._replace(sensors={"shank_right": recording.sensors["shank_right"]})


def test_a_shank_alone_has_an_angle_and_no_joints(walk, always):
    found = duty_cycled_gyro.estimate(P, shank_only(walk[0]), SLEEPY)
    assert found.legs.right is None and found.legs.left is None and found.stddev is None
    assert np.mean(found.valid) > 0.9
    error = found.diagnostics["angle_shank_right"] - always.diagnostics["angle_shank_right"]
    slept = found.valid & (found.time > WARM)
    stated = found.diagnostics["angle_stddev_shank_right"]
    assert np.sqrt(np.mean((error[slept] / stated[slept]) ** 2)) < 1.2


def test_a_filled_recording_is_taken_by_others(walk):
    recording = walk[0]
    used = gyroscope_masks(recording, list(recording.sensors), schedule=SLEEPY.schedule, warm_up=WARM)
    found = fill_recording(recording, schedule=SLEEPY.schedule, warm_up=WARM, filler="neighbours")
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    other = altered(recording, gyr=lambda v: v @ turn.T, acc=lambda v: v @ turn.T)
    turned = fill_recording(other, schedule=SLEEPY.schedule, warm_up=WARM)
    for name, imu in found.sensors.items():
        true, on = np.asarray(recording.sensors[name].gyr), used[name].usable
        np.testing.assert_allclose(imu.gyr[on], true[on], atol=1e-12)
        kept = imu.mask
        assert kept[on].all() and kept.mean() > 0.9 and np.all(np.isfinite(imu.gyr))
        np.testing.assert_allclose(turned.sensors[name].gyr, imu.gyr @ turn.T, atol=1e-9)
        if name.startswith("shank"):
            off = imu.gyr[~on & kept] - true[~on & kept]
            assert np.sqrt(np.mean(off**2) / np.mean(true[~on & kept] ** 2)) < 0.5
    assert any(note.startswith("shank_right: of the gyroscope's samples") for note in texts(found.notes))
    inputs = leg_ekf.prepared(found).inputs
    np.testing.assert_array_equal(inputs.right.shank.measured, found.sensors["shank_right"].mask)
    early = fill_recording(recording, schedule=SLEEPY.schedule, warm_up=1.0)
    assert not early.sensors["shank_right"].mask.all() and early.sensors["thigh_right"].mask.all()


def test_recordings_and_masks_that_do_not_fit_are_refused(walk):
    recording = walk[0]
    with pytest.raises(RecordingError, match="needs 40 to 400 Hz; the recording has 25 Hz: .* a shank turns by up to"):
        duty_cycled_gyro.prepared(part(walk[0], slice(None, None, 2))._replace(sampling_rate_hz=25.0))
    with pytest.raises(
        RecordingError, match=r"needs 'thigh_right' or 'shank_right', .*; the recording has \['waist'\]"
    ):
        duty_cycled_gyro.prepared(recording._replace(sensors={"waist": recording.sensors["thigh_right"]}))
    bare = altered(shank_only(recording), acc=lambda _: None)
    with pytest.raises(RecordingError, match="'neighbours' needs an accelerometer; 'shank_right' has only"):
        duty_cycled_gyro.prepared(bare, SLEEPY)
    with pytest.raises(RecordingError, match="'neighbours' needs an accelerometer"):
        fill_recording(bare, schedule=0.5)
    assert "drift" in " ".join(texts(duty_cycled_gyro.prepared(bare).notes))
    with pytest.raises(ValueError, match="gyro_on has a mask of 'foot_left'"):
        duty_cycled_gyro.prepared(recording, gyro_on={"foot_left": np.ones(3, bool)})
    with pytest.raises(ValueError, match=r"gyro_on of 'shank_left' must be \(\d+,\) bool; got \(3,\) bool"):
        duty_cycled_gyro.prepared(recording, gyro_on={"shank_left": np.ones(3, bool)})
    with pytest.raises(RecordingError, match="duty_cycled_gyro needs 0.5 s of quiet standing.*on together for 0.0 s"):
        duty_cycled_gyro.prepared(
            recording, gyro_on={"shank_left": np.zeros(recording.sensors["shank_left"].time.size, bool)}
        )
    with pytest.raises(ValueError, match="the filler 'replicate' takes parameters of type Replicate.*got Neighbours"):
        duty_cycled_gyro.estimate(P, recording, DEFAULT._replace(filler="replicate"))
    with pytest.raises(ValueError, match="parameter 'filled_noise' must lie in"):
        duty_cycled_gyro.estimate(P._replace(filled_noise=-1.0), recording)


def test_a_file_whose_gyroscope_slept_keeps_its_accelerometer(walk, tmp_path):
    """Columns that are empty while the gyroscope slept, read and filled, are what a mask of the whole walk gives."""
    recording = walk[0]
    imu = recording.sensors["shank_right"]
    on = gyroscope_masks(recording, ["shank_right"], schedule=SLEEPY.schedule, warm_up=WARM)["shank_right"].usable
    table = io.recording_to_dataframe(recording)
    table.loc[~on, [f"shank_right_gyr_{axis}" for axis in "xyz"]] = np.nan
    table.to_csv(tmp_path / "slept.csv", index=False)
    slept = io.read_csv(tmp_path / "slept.csv")
    assert {note.code for note in slept.notes} >= {"data_lost"}
    there = slept.sensors["shank_right"].mask
    np.testing.assert_array_equal(there, on)
    np.testing.assert_allclose(slept.sensors["shank_right"].acc, imu.acc, atol=1e-6)
    ours, other = (
        fill_recording(one, gyro_on={"shank_right": on}).sensors["shank_right"] for one in (slept, recording)
    )
    np.testing.assert_array_equal(ours.mask, other.mask)
    np.testing.assert_allclose(ours.gyr, other.gyr, atol=1e-4)  # the file has nine digits
    assert np.abs(ours.gyr[~on & ours.mask]).max() > 1.0


def test_in_a_loss_the_accelerometer_measures_nothing(walk):
    """What it read last is no measurement: a loss of 0.2 s in a swing makes the angle unsure, and not wrong."""
    recording = walk[0]
    time = times(recording)
    lost = np.abs(time - WARM - 1.2) < 0.1
    ours = duty_cycled_gyro.estimate(P, hidden(recording, lost, "shank_right"))
    after = (time > WARM + 1.3) & (time < WARM + 2.2)
    name = "angle_shank_right"
    usual = duty_cycled_gyro.estimate(P, hidden(recording, time < 0.05, "shank_right")).diagnostics[name]
    off = np.abs(ours.diagnostics[name] - usual)[after]
    assert np.all(off < 3.0 * ours.diagnostics["angle_stddev_shank_right"][after])
    made = duty_cycled_gyro.prepared(hidden(recording, lost, "shank_right"))
    np.testing.assert_array_equal(made.inputs.right.shank.acc_measured, ~lost)
    asleep = duty_cycled_gyro.prepared(recording, gyro_on={"shank_right": ~lost}).inputs.right.shank
    np.testing.assert_array_equal(asleep.on, ~lost)
    assert asleep.acc_measured.all()


def test_angles_after_a_u_turn_lie_within_their_deviations():
    ((recording, truth),) = simulate.cohort(
        jax.random.key(3), 1, simulate.u_turn(4.0), IDEAL, 50.0, simulate.FOUR, recorded=False
    )
    true = truth.estimate

    def beyond_and_error(p):
        found = duty_cycled_gyro.estimate(p, recording)
        beyond, squares = [], []
        for side in SIDES:
            for joint in ("hip_angle", "knee_angle"):
                ours, theirs, stated = (
                    np.asarray(getattr(getattr(legs, side), joint)) for legs in (found.legs, true.legs, found.stddev)
                )
                start = slice(*found.diagnostics["standing"])
                error = (ours - ours[start].mean()) - (theirs - theirs[start].mean())
                walks = np.arange(len(error)) > start.stop
                beyond.append(np.abs(error[walks]) > 2.0 * stated[walks])
                squares.append(error[walks] ** 2)
        return np.mean(beyond), np.degrees(np.sqrt(np.mean(squares)))

    usual, without = (beyond_and_error(p) for p in (DutyCycledParams(), DutyCycledParams(turn_tilt=1e-6)))
    assert usual[0] < 0.1 < without[0]
    assert usual[1] < 0.8 * without[1]
