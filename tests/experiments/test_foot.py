"""The foot's experiment: its scores and its quick form."""

from types import SimpleNamespace

import jax
import numpy as np
import pytest

from experiments.foot_ins import feet as real
from experiments.foot_ins import pivot
from experiments.foot_ins import run as running
from jgait import simulate
from jgait.estimators import foot_ins
from jgait.estimators.foot_ins import FootParams
from jgait.simulate import sensors

pytestmark = pytest.mark.release


@pytest.fixture(scope="module")
def walk():
    """A simulated foot with strides that are known."""
    key, along = jax.random.key(1), simulate.straight(10.0)
    person = simulate.covering(key, simulate.Person(), along)
    recording, truth = simulate.recording(key, person, along, sensors.OPAL, 200.0, placements=("foot_right",))
    strides = jax.tree.map(np.asarray, truth.strides)
    own = strides.valid & (strides.side == 0)
    swings = np.stack([strides.final_contact, strides.end], axis=1)[own]
    origin = truth.motion.pose.foot_right.origin
    position = np.stack([np.asarray(origin.x), np.asarray(origin.y)], axis=1)
    ends = swings + np.array([-0.3, 0.2])
    time = np.asarray(truth.estimate.time)
    return real.Foot("simulated", "one right", "right", recording, ends, strides.length[own], time, position)


def test_a_simulated_foot_is_found_cut_and_learned_from(walk, monkeypatch):
    item = running.Ready(walk, foot_ins.prepared(walk.recording).inputs)
    one = running.solved(FootParams(), item)
    assert one.lost == 0
    np.testing.assert_array_equal(one.rows, np.arange(len(walk.length)))
    assert np.abs(one.error).max() < 0.06
    assert one.rmse < 0.1
    np.testing.assert_allclose(one.length, walk.length)
    # the experiment's own call gives what users get
    theirs = foot_ins.estimate(FootParams(), walk.recording)
    ours = running.estimated(FootParams(), item.inputs)
    np.testing.assert_allclose(ours.strides.length, theirs.strides.length, rtol=1e-9)
    np.testing.assert_allclose(ours.feet.right.position, theirs.feet.right.position, atol=1e-9)
    half = real.cut(walk, len(walk.time) // 2)
    assert 0 < len(half.strides) < len(walk.strides)
    assert half.recording.sensors["foot_right"].time.size == len(walk.time) // 2
    # a lesson names the same strides, and its loss is the error that the score has
    lesson = pivot.lesson(item, 4096)
    assert lesson.weight.sum() == len(walk.length)
    size = np.sqrt((100.0 * one.error) ** 2 + pivot.ROUND**2).mean()
    monkeypatch.setattr(pivot, "foot_ins", SimpleNamespace(run=running.run_one))
    loss = pivot.Loss(foot_ins.DEFAULT)(FootParams(), lesson)
    np.testing.assert_allclose(loss, size, rtol=1e-9)


def test_quick_form(load_experiment, data):
    """On footprints, without the learning, whose gradient compiles a program of its own."""
    data("footprints")
    parts = [load_experiment(f"foot_ins.{name}") for name in ("strides", "ablation", "speed", "simulated")]
    rows = {row.metric: row for part in parts for row in part.rows(quick=True)}
    assert rows["foot_stride_mae_cm_footprints"].value < 2.2
    assert rows["foot_stride_mae_cm_footprints"].n >= 20
    assert rows["foot_strides_lost"].value == 0.0
    # the pivot is what takes the bias away
    textbook = rows["ablation_textbook_stride_mae_cm_footprints"].value
    assert textbook > 1.5 * rows["ablation_default_stride_mae_cm_footprints"].value
    assert rows["float32_position_mm"].value < 2.0
    assert rows["one_foot_hour_seconds"].value > 0.0
    assert rows["subjects_seconds"].n == 2
    assert rows["sim_straight_strides_lost"].value == 0.0
    assert rows["sim_straight_stride_mae_cm"].value < 3.0
