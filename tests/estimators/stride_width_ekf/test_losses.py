"""Lost samples of a foot: what is not known of its way makes widths uncertain, and wrong ones are not stated."""

import jax
import numpy as np
import pytest
from made.estimators import part, without

import jgait
from experiments.common import protocols
from jgait.estimators import stride_width_ekf as sw
from jgait.types import SIDES


@pytest.fixture(scope="module")
def walked():
    one = protocols.potter(jax.random.key(0), straight=10.0, after=4.0)[0]
    return one.recording, one.truth.estimate.strides, sw.with_body(sw.WidthParams(), {"range_offset": 0.08})


@pytest.mark.parametrize(("lost", "begin", "seconds"), [(SIDES, 6.0, 0.5), (SIDES, 5.0, 3.0), (("left",), 5.0, 3.0)])
def test_widths_after_a_loss_are_right_or_said_to_be_unsure(walked, lost, begin, seconds):
    recording, true, p = walked
    record = sw.estimator(sw.DEFAULT)
    made = record.prepare(without(recording, begin, seconds, *(f"foot_{side}" for side in lost)))
    assert made.options == sw.DEFAULT
    codes = [note.code for note in made.notes]  # those of the feet come first
    assert not any(code.startswith("range") for code in codes[: codes.index("samples_lost")])
    found = record.solve(p, made)
    strides, trusted = found.strides, np.asarray(found.diagnostics["width_valid"], bool)
    errors, stated = [], []
    for row in np.flatnonzero(np.asarray(strides.valid) & trusted):
        same = np.flatnonzero(np.asarray(true.valid) & (np.asarray(true.side) == strides.side[row]))
        near = same[np.argmin(np.abs(np.asarray(true.end)[same] - strides.end[row]))]
        if np.isfinite(true.width[near]):
            errors.append(float(strides.width[row] - true.width[near]))
            stated.append(float(found.strides_stddev.width[row]))
    assert len(errors) > 10 and np.all(np.abs(errors) < 3.5 * np.array(stated)) and np.max(np.abs(errors)) < 0.1


def test_a_foot_that_takes_one_stride_has_its_length_and_no_width(walked):
    recording, true, p = walked
    second = np.sort(np.asarray(true.end)[np.asarray(true.valid)])[1]
    found = sw.estimate(p, part(recording, slice(int((second + 0.3) * recording.sampling_rate_hz))))
    assert 0 < len(found.strides.length) < 4 and np.all(found.strides.length > 0.3)
    assert np.isnan(found.strides.width).all() and not found.diagnostics["width_valid"].any()
    assert "few_strides" in [note.code for note in found.diagnostics["notes"]]


def test_strides_that_share_a_foothold_with_a_doubtful_one_have_no_reliable_width(walked):
    recording, _, p = walked
    record = sw.estimator(sw.DEFAULT)
    made = record.prepare(recording)
    feet, stances = made.extra
    row = int(feet.strides.side.size // 3)
    doubtful = np.arange(feet.strides.side.size) == row
    doubted = feet._replace(diagnostics={**feet.diagnostics, "doubtful": doubtful})
    valid, fewer = (
        np.asarray(record.solve(p, made._replace(extra=(one, stances))).diagnostics["width_valid"])
        for one in (feet, doubted)
    )
    # itself, those of its side before and after it, and those of the other side that pass its begin or its end
    assert np.flatnonzero(valid & ~fewer).tolist() == list(range(row - 2, row + 3))


def test_a_default_offset_of_the_range_is_named_where_a_range_is_used(walked):
    recording = walked[0]
    silent = recording._replace(feet_range=recording.feet_range._replace(mask=recording.feet_range.mask & False))
    with_default, given, unused = (
        [note.values for note in jgait.analyse(one, person).notes if note.code == "range_offset_absent"]
        for one, person in ((recording, {}), (recording, {"range_offset": 0.09}), (silent, {}))
    )
    assert with_default == [{"offset": 0.08}] and not given and not unused
