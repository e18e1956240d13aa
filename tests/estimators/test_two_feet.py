"""Both feet in one filter: errors move as stated, one world, what the range tells, and what it means to have none.

One walk of eight seconds, and one compiled program, since a smoother of 33 states takes a minute to compile.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jgait.estimators import foot_ins, two_feet, two_feet_model
from jgait.estimators.foot_ins.model import FootControl, FootError, FootModelParams, FootState
from jgait.estimators.two_feet_model import Plane, TwoFeetControl, TwoFeetError, TwoFeetModelParams, TwoFeetState
from jgait.filtering import Covariance
from jgait.geometry.rotation import exponential
from jgait.geometry.vectors import Vector
from jgait.simulate import protocols
from jgait.types import RangeReadings, RecordingError

PARAMS = two_feet.TwoFeetParams(range_offset=2.0 * protocols.SKIN)


@pytest.fixture(scope="module")
def walk():
    """Six metres straight on; nothing turns."""
    return protocols.potter(jax.random.key(5), 1, straight=4.0, after=2.0, turn=0.02, rate=64.0)[0]


@pytest.fixture(scope="module")
def recording(walk):
    return walk.recording._replace(feet_range=walk.extra["range"])


@pytest.fixture(scope="module")
def estimated(recording):
    """The left foot's heading wrong by 10° at the start."""
    return two_feet.estimate(PARAMS, recording, start_heading=(0.0, np.radians(10.0)))


@pytest.fixture(scope="module")
def deaf(recording):
    """The same without a single range."""
    heard = recording.feet_range
    return two_feet.estimate(PARAMS, recording._replace(feet_range=heard._replace(mask=0 * heard.mask > 1)))


def width_errors(walk, estimate):
    """Of every stride that has a width."""
    true, told = walk.truth.estimate.strides, estimate.strides
    found = []
    for side, end, width in zip(told.side, told.end, told.width, strict=True):
        row = np.flatnonzero((np.asarray(true.side) == side) & (np.abs(np.asarray(true.end) - end) < 0.3))
        if np.isfinite(width) and row.size:
            found.append(width - float(true.width[row[0]]))
    return np.array(found)


def some(seed, *, size=1.0):
    """A state, an error, a control and parameters in which everything is at work."""
    draw = iter(0.1 * np.random.default_rng(seed).normal(size=200))

    def vector(scale=1.0):
        return Vector(*(jnp.asarray(scale * next(draw)) for _ in range(3)))

    def foot():
        turn = exponential(vector(3.0))
        return FootState(vector(5.0), vector(10.0), turn, vector(0.1), vector(0.3))

    def error():
        return FootError(*(vector(size) for _ in range(5)))

    def control():
        noise = (jnp.asarray(1e-3), jnp.asarray(1e-2), jnp.asarray(1e-4), jnp.asarray(1.0))
        return FootControl(vector(10.0), vector(50.0)._replace(z=jnp.asarray(9.0)), *noise)

    state = TwoFeetState(foot(), foot(), jnp.asarray(0.4), Plane(jnp.asarray(0.3), jnp.asarray(-0.2)))
    moved = TwoFeetError(
        error(), error(), jnp.asarray(size * 0.07), Plane(*(jnp.asarray(size * v) for v in (0.03, -0.1)))
    )
    distance, late, *steps = (jnp.asarray(v) for v in (0.3, 0.002, 0.01, 0.012))
    u = TwoFeetControl(control(), control(), distance, late, Plane(jnp.asarray(0.6), jnp.asarray(0.8)), *steps)
    p = TwoFeetModelParams(FootModelParams(0.08, 1e-10, 1e-8, 1e-4), 0.01, 1e-4, 1.6e-3)
    return p, state, moved, u


def difference(after, reference, tolerance):
    for name, a, b in zip(Covariance.from_variances(after).names, jax.tree.leaves(after), jax.tree.leaves(reference),
                          strict=True):  # fmt: skip
        assert float(a) == pytest.approx(float(b), abs=tolerance), name


def scaled(error, factor):
    return jax.tree.map(lambda v: factor * v, error)


def test_errors_move_and_show_as_the_model_states():
    p, s, e, u = some(1)
    step = 1e-4

    def central(function, subtract):
        ahead, behind = (function(two_feet_model.retract(s, scaled(e, sign * step))) for sign in (1.0, -1.0))
        return scaled(subtract(behind, ahead), 0.5 / step)

    stated = e
    for move in (two_feet_model.fold_error, two_feet_model.turn_error, two_feet_model.move_error):
        stated = move(p, s, stated, u, 0.0)
    numeric = central(lambda at: two_feet_model.transition(p, at, u, 0.0), two_feet_model.local)
    difference(stated, numeric, 2e-6)
    assert float(jnp.abs(stated.between.x - e.between.x)) > 1e-3  # footholds were left
    shown = two_feet_model.error_observation(p, s, e, u)
    numeric = central(lambda at: two_feet_model.observation(p, at, u), lambda a, b: jax.tree.map(jnp.subtract, b, a))
    difference(shown, numeric, 1e-6)


def test_a_foothold_that_is_left_does_not_move_the_feet():
    p, s, _, u = some(2)
    still = u._replace(dt_right=jnp.asarray(0.0), dt_left=jnp.asarray(0.0))
    after = two_feet_model.transition(p, s, still, 0.0)
    difference(two_feet_model.relative(after), two_feet_model.relative(s), 1e-12)
    assert float(after.right.position.x) == float(after.left.position.y) == 0.0


def test_a_range_beside_the_passing_is_longer_than_the_distance_across():
    p, s, _, u = some(3)
    p = p._replace(passing=0.0)
    ahead = Vector(jnp.asarray(2.0), jnp.asarray(0.0), jnp.asarray(0.0))
    none = Vector(*(jnp.asarray(0.0),) * 3)
    right, left = s.right._replace(position=none, velocity=ahead), s.left._replace(position=none, velocity=none)
    d = Plane(jnp.asarray(0.04), jnp.asarray(-0.12))  # the right foot 4 cm ahead and 12 cm to the right
    s = s._replace(right=right, left=left, between=d)
    u = u._replace(distance=jnp.hypot(*d), late=0.0, ahead=Plane(1.0, 0.0))
    across, along = two_feet_model.passing(p, s, u)
    assert float(across) == pytest.approx(float(u.distance), abs=1e-6)
    assert float(along) == pytest.approx(0.04, abs=1e-6)


def test_widths_within_a_centimetre_though_the_start_is_ten_degrees_off(walk, estimated):
    error = width_errors(walk, estimated)
    assert error.size >= 7
    assert np.mean(np.abs(error)) < 0.012
    known = np.isfinite(estimated.strides.width)
    assert np.all(estimated.diagnostics["width_valid"] == known)
    spread = estimated.strides_stddev
    assert np.all((spread.width[known] > PARAMS.offset_noise) & (spread.width[known] < 0.03))
    assert np.all(np.abs(error) < 3.0 * spread.width[known].max())
    assert estimated.diagnostics["yaw_stddev"] < 0.03 < PARAMS.start_heading
    assert np.all(estimated.valid)


def test_the_feet_share_a_world(estimated):
    """Widths and steps measured in the trajectories are those of the strides."""
    s, time = estimated.strides, estimated.time
    feet = [foot.position[:, :2] for foot in estimated.feet]
    assert np.allclose(feet[0][0], 0.0, atol=1e-3)
    first = np.flatnonzero(s.side == 0)[0]
    way = feet[0][np.searchsorted(time, s.standing_end[first])] - feet[0][np.searchsorted(time, s.standing[first])]
    assert abs(np.arctan2(way[1], way[0])) < 0.02
    assert 0.2 < feet[1][0][1] < 0.4  # the left foot to the left
    speed = [np.hypot(*foot.velocity[:, :2].T) for foot in estimated.feet]
    for k in np.flatnonzero(np.isfinite(s.width)):
        side = int(s.side[k])
        a, b = np.searchsorted(time, [s.standing[k], s.standing_end[k]])
        between = a + int(np.argmin(speed[1 - side][a:b]))
        start, end, other = feet[side][a], feet[side][b], feet[1 - side][between]
        way, aside = end - start, other - start
        width = (way[0] * aside[1] - way[1] * aside[0]) / np.hypot(*way) * (1.0 if side == 0 else -1.0)
        assert width == pytest.approx(s.width[k], abs=0.015)  # a standing foot still rolls
        assert way @ aside / np.hypot(*way) == pytest.approx(s.step_length[k], abs=0.03)


def test_the_range_brings_a_wrong_heading_back(recording, estimated):
    other = two_feet.estimate(PARAMS, recording, start_heading=(0.0, np.radians(-10.0)))
    apart = abs(float(other.diagnostics["yaw"] - estimated.diagnostics["yaw"]))
    assert apart < np.radians(2.0)  # of 20°
    assert np.nanmax(np.abs(other.strides.width - estimated.strides.width)) < 0.02


def test_without_a_range_each_foot_is_as_alone_and_widths_are_flagged(recording, deaf, estimated):
    alone = foot_ins.estimate(PARAMS.foot, recording)
    for name in ("side", "length", "height", "speed", "turn", "lift", "contact_angle"):
        assert np.allclose(getattr(deaf.strides, name), getattr(alone.strides, name), atol=1e-5), name
    assert np.allclose(deaf.strides_stddev.length, alone.strides_stddev.length, rtol=1e-3)
    assert np.allclose(deaf.feet.right.position, alone.feet.right.position, atol=1e-4)
    assert deaf.diagnostics["ranges"] == 0 and not np.any(deaf.diagnostics["width_valid"])
    assert any("widths cannot be told" in note for note in deaf.diagnostics["notes"])
    grows = deaf.diagnostics["z1_stddev"]
    assert grows[-1] > 2.0 * grows[0] and grows[-1] > 5.0 * estimated.diagnostics["z1_stddev"][-1]


def test_the_sensors_may_sit_in_any_way(recording, estimated):
    """Turning the left sensor in its mount turns its world, and nothing else."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) @ np.diag([1.0, -1.0, -1.0])
    imu = recording.sensors["foot_left"]
    sensors = {**recording.sensors, "foot_left": imu._replace(gyr=imu.gyr @ turn.T, acc=imu.acc @ turn.T)}
    other = two_feet.estimate(PARAMS, recording._replace(sensors=sensors), start_heading=(0.0, np.radians(10.0)))
    for name in ("width", "step_length", "length"):
        assert np.allclose(getattr(other.strides, name), getattr(estimated.strides, name), atol=1e-4, equal_nan=True)


def test_padding_changes_nothing(recording):
    inputs = two_feet.prepare(recording).inputs
    samples = inputs.time.size
    longer = two_feet.pad(inputs, samples + 50)
    assert longer.time.size == longer.heading_left.size == longer.right.rate.size == samples + 50
    assert np.all(np.diff(longer.time) > 0.0)
    assert not longer.seen[samples:].any() and np.all(longer.distance[samples:] > 0.0)
    assert not longer.right.dt[samples:].any() and not longer.left.stands[samples:].any()
    with pytest.raises(ValueError, match="pad only lengthens"):
        two_feet.pad(inputs, samples - 1)


def test_what_cannot_be_used_says_why(recording):
    one = recording._replace(sensors={"foot_right": recording.sensors["foot_right"]})
    with pytest.raises(RecordingError, match="two_feet needs 'foot_right' and 'foot_left'; the recording has"):
        two_feet.prepare(one)
    with pytest.raises(ValueError, match="two_feet takes pivot_height, range_offset, passing_offset"):
        two_feet.with_body(PARAMS, {"thigh_length": 0.4})
    own = two_feet.with_body(PARAMS, {"pivot_height": 0.1, "range_offset": 0.05})
    assert own.foot.pivot_height == 0.1 and own.range_offset == 0.05
    with pytest.raises(ValueError, match="level must be True, False or 'auto'; got 'up'"):
        two_feet.run(PARAMS, two_feet.prepare(recording).inputs, two_feet.DEFAULT._replace(level="up"))
    broken = RangeReadings(np.zeros(3), np.zeros(2), np.ones(3, bool))
    with pytest.raises(RecordingError, match="times, distances and mask of one length"):
        two_feet.prepare(recording._replace(feet_range=broken))
