"""Doubt about positions: trials of `pyshoe_vicon` that are off without a flag, or flagged though they are good.

A trial is off if its position errs by more than 0.5 m, or by more than three times what the deviations of its strides,
and the largest within one, add up to. The model of doubt (`jgait.quality`) was learned on these trials, too.
"""

from typing import NamedTuple

import numpy as np

from experiments.common.recordings import attempt, available, names, walks
from experiments.common.row import Row, show
from experiments.unseen.flags import ALLOWED
from jgait.estimators import foot_ins
from jgait.evaluate import yaw_aligned
from jgait.quality import trust
from jgait.types import Walk, as_float

SET, FAR = "pyshoe_vicon", 0.5
"""Its trials; [m] error of a position from which on a trial is off."""


class Trial(NamedTuple):
    """A trial of `pyshoe_vicon`: its largest error [m], the deviation that its strides state [m], and its trust."""

    name: str
    error: float
    stated: float
    trusted: bool

    @property
    def off(self) -> bool:
        """Whether the trial is wrong by more than it says."""
        return self.error > FAR or self.error > ALLOWED * self.stated


def of_trial(walk: Walk) -> Trial:
    """The position of a trial, after a turn about the vertical and a shift."""
    estimate, reference = foot_ins.estimate(foot_ins.FootParams(), walk.recording), walk.reference
    assert reference is not None
    good = np.asarray(reference.valid, bool) & np.asarray(estimate.valid, bool)
    assert estimate.feet is not None
    assert reference.feet is not None
    ours, theirs = (np.asarray(feet.right.position)[good] for feet in (estimate.feet, reference.feet))
    apart = np.linalg.norm(yaw_aligned(ours, theirs) - theirs, axis=1)
    stated = estimate.strides_stddev
    assert stated is not None
    assert estimate.feet_stddev is not None
    within = np.asarray(estimate.feet_stddev.right.position)[good].max()
    total = float(np.sqrt(np.sum(as_float(stated.length) ** 2) + within**2))
    return Trial(walk.recording.name, float(apart.max()), total, trust(estimate).recording)


def rows(quick: bool) -> list[Row]:
    """Of the trials that are here; none in the quick form."""
    every = walks(SET, names(SET)) if not quick and available(SET) else []
    found = [attempt(walk.recording.name, lambda walk=walk: of_trial(walk)) for walk in every]
    return of_trials([one for one in found if one is not None])


def of_trials(trials: list[Trial]) -> list[Row]:
    """Rows of the trials of `pyshoe_vicon`."""
    if not trials:
        return []
    lines = [
        [one.name, one.error, one.stated, "off" if one.off else "", "" if one.trusted else "doubt"]
        for one in trials if one.off or not one.trusted
    ]  # fmt: skip
    show("Trials of pyshoe_vicon that are off or in doubt", ["", "largest error [m]", "stated [m]", "", ""], lines)
    missed = sum(one.off and one.trusted for one in trials)
    false = sum(not one.off and not one.trusted for one in trials)
    line, n = "doubt, positions, `pyshoe_vicon`", len(trials)
    return [
        Row("trials_missed", float(missed), "trials", n=n, split="limits chosen on these trials").on(
            f"{line}: beyond 0.5 m or three stated deviations without a flag", "", "trials"
        ),
        Row("trials_false", float(false), "trials", n=n, split="limits chosen on these trials").on(
            f"{line}: flagged though good", "", "trials"
        ),
    ]
