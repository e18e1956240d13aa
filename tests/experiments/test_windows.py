"""Parts of a walk that are judged or learned from, by their names and samples."""

import numpy as np
import pytest
from made import cohort as made_cohort

from experiments.common.windows import judge, named_windows
from jgait import tune


def test_ranges_of_samples_and_masks_are_judged_alike():
    reference = made_cohort.walk(1).reference
    estimate = reference._replace(distance=1.1 * reference.distance)
    index = np.arange(reference.time.size)
    by_range = judge(estimate, reference, (100, 300), (0, 50))
    assert by_range == judge(estimate, reference, (index >= 100) & (index < 300), index < 50)
    assert by_range.distance_error_pct == pytest.approx(10.0)


def test_windows_by_name_are_in_samples_of_the_reference():
    walk = made_cohort.walk(1)
    fine = walk.reference._replace(
        time=np.linspace(0.0, walk.reference.time[-1], 2 * walk.reference.time.size - 1),
        distance=np.repeat(walk.reference.distance, 2)[:-1], legs=walk.reference.legs._replace(right=None, left=None),
        valid=np.ones(2 * walk.reference.time.size - 1, bool),
    )  # fmt: skip
    walk = walk._replace(reference=fine, info={"windows": {"straight": (100, 300), "standing": (0, 50)}})
    one = tune.lessons(made_cohort.FAKE, [walk], windows=named_windows("straight")).lesson(0)
    assert np.flatnonzero(one.look)[[0, -1]].tolist() == [50, 149]
    assert (int(one.first), int(one.last)) == (50, 149)
    assert np.flatnonzero(one.standing)[[0, -1]].tolist() == [0, 24]
    with pytest.raises(ValueError, match="no window 'back'; it has straight, standing"):
        tune.lessons(made_cohort.FAKE, [walk], windows=named_windows("back"))
