"""Stride width: the paper's protocol, what the range cannot tell, honest deviations, and the contract."""

import jax
import numpy as np
import pytest
from made.footsteps import OFFSET, WIDTH, distances, drifting, footsteps, widths

from experiments.common import protocols
from jgait import params
from jgait.estimators import stride_width_ekf as sw
from jgait.types import RangeReadings

KNOWN = sw.WidthParams(range_offset=OFFSET)


def told(walk, options=sw.DEFAULT, p=KNOWN, **changes):
    read = changes.pop("read", walk.read)
    made = sw.prepare_from_feet(walk.time, walk.feet, walk.mids, read, options, **changes)
    return sw.estimator(options).solve(p, made)


def errors(truth, estimate):
    """Errors of width and step length where there are both, and their stated deviations."""
    width, step = widths(truth, estimate.strides)
    there = np.isfinite(width)
    for one in (estimate.strides, estimate.strides_stddev):
        assert np.array_equal(there, np.isfinite(one.width))
    pairs = ((estimate.strides.width, width, estimate.strides_stddev.width),
             (estimate.strides.step_length, step, estimate.strides_stddev.step_length))  # fmt: skip
    return [(np.asarray(a)[there] - b[there], np.asarray(s)[there]) for a, b, s in pairs]


def sections(truth, estimate):
    """Mean and SD of the errors of z₁ and z₂ at double support, in the paper's three sections."""
    time, own = np.asarray(estimate.time), estimate.diagnostics
    z1, z2 = distances(truth, time)
    way = np.interp(time, truth.time, truth.places[0][:, 0])  # along the first straight
    turned = np.interp(time, truth.time, truth.places[0][:, 1]) < -3.0
    there = np.asarray(own["double_support"]) & ~np.asarray(own["turning"])
    parts = (there & (way < 28.0), there & (way >= 28.0) & (way < 49.0), there & turned)
    return [
        [(np.mean(e[part]), np.std(e[part])) for e in (np.asarray(own["z1"]) - z1, np.asarray(own["z2"]) - z2)]
        for part in parts
    ]


@pytest.fixture(scope="module")
def truth():
    return footsteps()


@pytest.fixture(scope="module")
def walk(truth):
    return drifting(truth, 1)


@pytest.fixture(scope="module")
def smoothed(walk):
    return told(walk, sw.DEFAULT, start_heading=(0.0, np.radians(10.0)))


def test_the_papers_protocol_within_a_centimetre_after_smoothing(truth):
    for seed, heading in enumerate(np.radians([10.0, -15.0])):
        estimate = told(drifting(truth, 10 + seed), start_heading=(0.0, float(heading)))
        found = sections(truth, estimate)
        for (z1_mean, z1_sd), _ in found:
            assert abs(z1_mean) <= 0.01 and z1_sd <= 0.01  # the paper: 0.246, 0.044, 0.033 m
        assert found[2][1][1] <= 0.03  # z₂ after the turn; the paper 0.554 m
        (width, _), (step, _) = errors(truth, estimate)
        assert np.mean(np.abs(width)) < 0.011
        assert np.mean(np.abs(step)) < 0.03
        assert np.all(estimate.diagnostics["width_valid"][np.isfinite(estimate.strides.width)])


def outside(strides):
    """Strides far from the turn: in it there are no ranges."""
    turned = np.flatnonzero(np.abs(np.asarray(strides.turn)) > 0.2)
    return np.abs(np.arange(strides.turn.size)[:, None] - turned[None, :]).min(axis=1) > 5


def test_a_foots_own_world_does_not_matter(truth, smoothed):
    other = told(drifting(truth, 1)._replace(places=tuple(p[:, [1, 0, 2]] * [-1.0, 1.0, 1.0] + 7.0
                                                          for p in drifting(truth, 1).places)),
                 start_heading=(0.0, np.radians(10.0)))  # fmt: skip
    np.testing.assert_allclose(other.strides.width, smoothed.strides.width, atol=1e-9)


def test_without_a_range_the_width_is_flagged_and_its_deviation_grows(truth, walk):
    far = walk.read._replace(distance=np.where(walk.read.mask, walk.read.distance + 0.6, 0.0))
    for read in (None, walk.read._replace(mask=walk.read.mask & False), far):
        estimate = told(walk, sw.DEFAULT._replace(usual_passings=False), read=read)
        assert not np.any(estimate.diagnostics["width_valid"])
        assert any(note.code.startswith("range_") for note in estimate.diagnostics["notes"])
        (error, stddev), _ = errors(truth, estimate)
        assert np.all(np.diff(stddev[:70:10]) > 0.0)  # straight on
        assert stddev[-1] > 2.0  # 75 m times the uncertainty of where the feet were heading
        assert np.max(np.abs(error) / stddev) < 4.0


@pytest.mark.parametrize("silent", [False, True])
def test_without_a_range_widths_have_the_mean_of_usual_people_and_changes_of_the_walk(truth, walk, silent):
    estimate = told(walk, sw.DEFAULT, read=walk.read._replace(mask=walk.read.mask & False) if silent else None)
    (error, stddev), _ = errors(truth, estimate)
    far = outside(estimate.strides)[np.isfinite(estimate.strides.width)]
    assert np.all(estimate.diagnostics["width_valid"][np.isfinite(estimate.strides.width)])
    assert estimate.diagnostics["ranges"] == 0
    assert np.std(error[far]) < 0.012
    assert np.all((stddev[far] > 0.025) & (stddev[far] < 0.035))
    # who is usual does not matter for the changes
    wider = told(walk, sw.DEFAULT, read=None, p=KNOWN._replace(usual_passing=0.165))
    change = (wider.strides.width - estimate.strides.width)[np.isfinite(estimate.strides.width)]
    np.testing.assert_allclose(change[far], 0.05, atol=0.005)


@pytest.mark.parametrize(("hz", "noise"), [(128.0, 0.005), (30.0, 0.002)])
def test_of_a_range_at_all_times_only_the_nearest_readings_count(truth, walk, hz, noise):
    """The distance between the feet is not across the walk but when they pass."""
    times = np.arange(truth.time[0], truth.time[-1], 1.0 / hz)
    right, left = (np.stack([np.interp(times, truth.time, place[:, i]) for i in (0, 1)], axis=1)
                   for place in truth.places)  # fmt: skip
    apart = np.linalg.norm(right - left, axis=1) - OFFSET
    read = RangeReadings(times, apart + noise * np.random.default_rng(0).normal(size=times.size), apart > 0.0)
    estimate = told(walk, read=read)
    there = outside(estimate.strides)
    np.testing.assert_allclose(np.nanmean(np.asarray(estimate.strides.width)[there]), WIDTH, atol=0.02)


@pytest.mark.parametrize("fault", ["short", "any moment"])
def test_ranges_that_do_not_fit_the_paths_of_the_feet_give_no_widths(walk, smoothed, fault):
    assert smoothed.diagnostics["misfits"] < 0.1 * smoothed.diagnostics["ranges"]
    rng, read = np.random.default_rng(0), walk.read
    if fault == "short":  # half of the passings
        passing = np.cumsum(np.diff(read.time[read.mask], prepend=0.0) > 0.2)
        short = rng.random(passing.max() + 1)[passing] < 0.5
        distance = read.distance.copy()
        distance[read.mask] *= np.where(short, 0.6, 1.0)
        read = read._replace(distance=distance)
    else:  # without a gap, so that they say nothing of when the feet pass each other
        read = read._replace(distance=rng.uniform(0.1, 0.3, walk.time.size), mask=walk.time > 0.0)
    estimate = told(walk, read=read)
    assert not np.any(estimate.diagnostics["width_valid"])
    note = next(note for note in estimate.diagnostics["notes"] if note.code == "ranges_misfit")
    assert note.severity == "check" and note.values["misfits"] > 0.3 * note.values["ranges"] > 3


def test_the_offset_shifts_the_width_by_as_much(walk, smoothed):
    assert params.unconstrain(KNOWN, sw.estimator().transforms).passing_noise is None  # made up, so never learned
    shifted = told(walk, p=KNOWN._replace(range_offset=OFFSET + 0.03), start_heading=(0.0, np.radians(10.0)))
    away = outside(smoothed.strides)
    np.testing.assert_allclose(np.asarray(shifted.strides.width - smoothed.strides.width)[away], 0.03, atol=2e-3)
    ahead = told(walk, p=KNOWN._replace(passing_offset=0.03), start_heading=(0.0, np.radians(10.0)))
    change = np.asarray(ahead.strides.step_length - smoothed.strides.step_length)
    side = np.asarray(ahead.strides.side)
    assert np.mean(change[side == 0]) == pytest.approx(-0.03, abs=4e-3)
    assert np.mean(change[side == 1]) == pytest.approx(0.03, abs=4e-3)
    np.testing.assert_allclose(ahead.strides.width[away], smoothed.strides.width[away], atol=4e-3)


def test_true_feet_and_a_true_range_give_the_true_width():
    exact = footsteps(before=10, turn=2, after=8, scatter=0.0)
    p = sw.WidthParams(OFFSET, 1e-9, 0.0, 1e-9, 1e-4, 1e-4, 1e-4, 2e-3, 0.04)
    estimate = told(exact, p=p)
    straight = np.abs(np.asarray(estimate.strides.turn)) < 1e-3
    assert np.nanmedian(np.abs(np.asarray(estimate.strides.width)[straight] - WIDTH)) < 2e-3
    np.testing.assert_allclose(np.asarray(estimate.strides.length)[straight], 1.22, atol=5e-3)
    at = np.asarray(estimate.diagnostics["double_support"]) & ~np.asarray(estimate.diagnostics["turning"])
    assert np.nanmedian(np.abs(np.abs(np.asarray(estimate.diagnostics["z2"])[at]) - 0.61)) < 0.02
    np.testing.assert_allclose(np.asarray(estimate.strides.height), 0.0, atol=1e-9)


@pytest.mark.release
def test_deviations_of_widths_hold_in_single_precision():
    """After tens of metres the variances of both places are large, and their difference is small."""
    (walked,) = protocols.potter(jax.random.key(4), 1, straight=50.0, after=5.0)
    estimator = sw.estimator()
    made = estimator.prepare(walked.recording)
    run = jax.jit(jax.vmap(lambda inputs: estimator.run(sw.WidthParams(), inputs, made.options)))
    spreads = []
    for kind in (np.float64, np.float32):
        inputs = jax.tree.map(lambda v: np.stack([v.astype(kind) if v.dtype == np.float64 else v] * 2), made.inputs)  # noqa: B023
        found = run(inputs)
        spreads.append(np.asarray(found.strides_stddev.width)[0][np.isfinite(found.strides.width[0])])
    assert spreads[1].dtype == np.float32 and spreads[0].size > 60
    np.testing.assert_allclose(spreads[1], spreads[0], rtol=1e-3)
