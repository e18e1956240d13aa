"""Contacts and sides of made trunks of which they are known, and of a real one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.events import trunk as trunk_events
from jgait.events.trunk import PaperRule, Peaks, Soft, initial_contacts

RATE, STEP = 100.0, 0.55
SAMPLES = 2750  # of everything that the compiled detectors see
FIRST, STEPS = 2.0, 12
CONTACTS = FIRST + STEP * np.arange(STEPS)
LEFT = np.arange(STEPS) % 2
DETECTORS = {"soft": Soft(), "peaks": Peaks(), "paper": PaperRule()}


def trunk(rate=RATE, seconds=SAMPLES / RATE, contacts=CONTACTS, strength=1.0, left=LEFT):
    """Forward and upward acceleration, and yaw rate: braked and thrown up at every contact, standing at both ends."""
    time = np.arange(round(seconds * rate)) / rate
    phase = 2.0 * np.pi * (time - contacts[0]) / STEP
    walks = 1.0 / (1.0 + np.exp(-20.0 * (time - contacts[0] + 0.3 * STEP)))
    walks = walks / (1.0 + np.exp(20.0 * (time - contacts[-1] - 0.3 * STEP)))
    forward, upward = -1.0 * np.sin(phase) * walks, 1.5 * np.cos(phase - 0.2) * walks
    yaw = np.zeros_like(time)
    for t, side in zip(contacts, left, strict=True):
        late = (time - t) / 0.02
        forward += -1.5 * late * np.exp(-0.5 * late**2)
        upward += 3.0 * np.exp(-0.5 * (late - 1.2) ** 2)
        yaw += (1.0 if side else -1.0) * 0.6 * np.exp(-0.5 * ((time - t - 0.9 * STEP) / (0.3 * STEP)) ** 2)
    return strength * forward, strength * upward, yaw


@pytest.fixture(scope="module")
def detect():
    """`detect(name, signals, mask)`, compiled once a detector."""
    programs = {
        name: jax.jit(lambda *x, s=settings: initial_contacts(*x[:3], RATE, s, mask=x[3]))
        for name, settings in DETECTORS.items()
    }
    every = np.ones(SAMPLES, bool)
    return lambda name, signals, mask=every: programs[name](*signals, mask)


def rows(found):
    """The valid rows in NumPy, after a look at the others."""
    valid = np.asarray(found.valid)
    for field in found:
        assert not np.asarray(field)[~valid].any()
    return trunk_events.Contacts(*(np.asarray(field)[valid] for field in found))


# The made trunk has one shape; how late a detector is on it is no error, how much that varies is one.
@pytest.mark.parametrize(("name", "spread"), [("soft", 0.01), ("peaks", 0.02), ("paper", 0.02)])
def test_every_contact_is_found_once_with_its_side(detect, name, spread):
    found = rows(detect(name, trunk()))
    assert len(found.time) == STEPS
    late = found.time - CONTACTS
    assert np.abs(late - np.median(late)).max() < spread
    assert np.abs(np.median(late)) < 0.06
    np.testing.assert_array_equal(found.side, LEFT)
    # the turn of the pelvis alone never makes a side certain
    assert 0.4 < found.certainty.min() <= found.certainty.max() < 0.5
    np.testing.assert_allclose(found.step_frequency, 1.0 / STEP, rtol=0.03)
    assert np.abs(found.coarse - CONTACTS).max() < 0.06


def test_a_foot_pushes_the_trunk_to_the_other_side_however_the_pelvis_turns():
    """The trunk is accelerated to the left while the right foot carries it; the yaw rate says the contrary here."""
    yaw, time = trunk()[2], np.arange(SAMPLES) / RATE
    leftward = 0.4 * np.random.default_rng(1).normal(size=SAMPLES)
    for t, side in zip(CONTACTS, LEFT, strict=True):
        leftward += (-1.0 if side else 1.0) * 0.8 * np.exp(-0.5 * ((time - t - 0.5 * STEP) / (0.25 * STEP)) ** 2)
    often, every = np.full(STEPS, 1.0 / STEP), np.ones(STEPS, bool)
    told = jax.jit(lambda *x: trunk_events.sides(CONTACTS, often, every, RATE, *x))
    np.testing.assert_array_equal(np.asarray(told(-yaw, leftward)) > 0.0, LEFT == 1)
    # on a bend to the left everything is accelerated to the left as well
    bend = 1.5 * np.exp(-0.5 * ((time - 5.0) / 0.8) ** 2)
    np.testing.assert_array_equal(np.asarray(told(-yaw, leftward + bend)) > 0.0, LEFT == 1)
    np.testing.assert_array_equal(np.asarray(told(yaw, -leftward)) > 0.0, LEFT == 0)


def test_signs_that_agree_make_a_side_sure_and_signs_that_disagree_leave_it_unknown():
    """When a right foot takes the weight the left side of the pelvis falls."""
    yaw, time = trunk()[2], np.arange(SAMPLES) / RATE
    roll, sway = np.zeros(SAMPLES), np.zeros(SAMPLES)
    for t, side in zip(CONTACTS, LEFT, strict=True):
        late = (time - t) / STEP
        roll += (1.0 if side else -1.0) * np.exp(-0.5 * ((late - 0.15) / 0.1) ** 2)
        sway += (-1.0 if side else 1.0) * np.exp(-0.5 * ((late - 0.5) / 0.2) ** 2)
    often, every = np.full(STEPS, 1.0 / STEP), np.ones(STEPS, bool)
    told = jax.jit(lambda *x: 1.0 / (1.0 + jnp.exp(-trunk_events.sides(CONTACTS, often, every, RATE, *x))))
    for signs, low, high in (((1, 1, 1), 0.97, 1.0), ((-1, 1, 1), 0.9, 1.0), ((1, 1, -1), 0.5, 0.85),
                             ((-1, -1, 1), 0.15, 0.5), ((-1, -1, -1), 0.0, 0.03)):  # fmt: skip
        of_the_side = np.asarray(told(signs[0] * yaw, signs[1] * sway, signs[2] * roll))
        of_the_side = np.where(LEFT == 1, of_the_side, 1.0 - of_the_side)[1:-1]
        assert low < of_the_side.min() <= of_the_side.max() < high, signs


def test_sides_hold_through_a_turn_and_a_contact_that_misleads(detect):
    forward, upward, yaw = trunk()
    time = np.arange(SAMPLES) / RATE
    turning = yaw + 2.0 * np.exp(-0.5 * ((time - 5.0) / 0.6) ** 2)  # 170 degrees to the left
    np.testing.assert_array_equal(rows(detect("soft", (forward, upward, turning))).side, LEFT)
    wrong = trunk(left=np.where(np.arange(STEPS) == 6, 1, LEFT))[2]
    np.testing.assert_array_equal(rows(detect("soft", (forward, upward, wrong))).side, LEFT)


def test_a_step_that_was_not_detected_does_not_change_the_sides_after_it():
    seen = np.delete(np.arange(STEPS), 5)
    yaw = trunk()[2]
    told = jax.jit(lambda *x: trunk_events.sides(*x[:3], RATE, x[3]))
    odds = told(CONTACTS[seen], np.full(seen.size, 1.0 / STEP), np.ones(seen.size, bool), yaw)
    np.testing.assert_array_equal(np.asarray(odds) > 0.0, LEFT[seen] == 1)


def test_who_does_not_walk_has_no_contact(detect):
    quiet = 0.1 * np.random.default_rng(0).normal(size=(3, SAMPLES))
    for name in DETECTORS:
        assert not detect(name, quiet).valid.any()
    assert not detect("soft", trunk(strength=0.05)).valid.any()
    few = trunk(contacts=CONTACTS[:2], left=LEFT[:2])
    assert not detect("soft", few).valid.any()
    assert not detect("soft", np.zeros((3, SAMPLES))).valid.any()


@pytest.mark.parametrize(("rate", "settings"), [(25.0, Soft()), (400.0, PaperRule(relative_to="max", hard=True))])
def test_supported_rates_find_the_same_contacts_in_single_precision(detect, rate, settings):
    single = [x.astype(np.float32) for x in trunk(rate, 10.0)]
    found = rows(jax.jit(lambda *x: initial_contacts(*x, rate, settings))(*single))
    usual = rows(detect("paper" if isinstance(settings, PaperRule) else "soft", trunk()))
    assert found.time.dtype == np.float32
    assert len(found.time) == STEPS
    np.testing.assert_array_equal(found.side, LEFT)
    # Half a sample of 25 Hz; a jolt of 20 ms is hardly seen in such.
    assert np.abs(found.time - usual.time).max() < 0.02


def test_a_trunk_signal_that_cannot_be_used_is_refused_with_the_reason():
    forward, upward, yaw = trunk()
    with pytest.raises(ValueError, match="between 25 and 400 Hz; got 20"):
        initial_contacts(forward, upward, yaw, 20.0)
    with pytest.raises(ValueError, match=r"yaw_rate has shape \(2749,\)"):
        initial_contacts(forward, upward, yaw[1:], RATE)
    with pytest.raises(ValueError, match=r"leftward has shape \(2749,\)"):
        initial_contacts(forward, upward, yaw, RATE, leftward=yaw[1:])
    with pytest.raises(ValueError, match=r"T >= 10; forward has shape \(9,\)"):
        initial_contacts(forward[:9], upward[:9], yaw[:9], RATE)
    with pytest.raises(ValueError, match="upward must be floating point; got int64"):
        initial_contacts(forward, upward.astype(int), yaw, RATE)


def test_a_real_walk_there_and_back(data, detect):
    walk = next(w for w in data("ipol_gait") if w.recording.name == "12-1")
    worn = walk.recording.sensors["lower_back"]
    up = worn.acc[:300].mean(axis=0)
    up /= np.linalg.norm(up)
    ahead = np.array([0.0, 0.0, -1.0]) + up[2] * up
    ahead /= np.linalg.norm(ahead)
    # The lean of the trunk is taken to be that of standing: contacts need no more.
    acc = worn.acc[:SAMPLES] - 9.80665 * up
    found = rows(detect("soft", (acc @ ahead, acc @ up, worn.gyr[:SAMPLES] @ up)))
    told, side = walk.info["initial_contacts"], walk.info["initial_contact_sides"]
    time = found.time + worn.time[0]
    nearest = np.abs(time[:, None] - told[None, :]).argmin(axis=0)
    error = time[nearest] - told
    hit = np.abs(error) < 0.2
    assert hit.sum() >= len(told) - 1 and len(time) <= len(told) + 1
    assert np.abs(error[hit] - np.median(error[hit])).mean() < 0.025
    assert (found.side[nearest] == side)[hit].mean() >= 0.95
