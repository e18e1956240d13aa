"""Distances of `walking5m`, with one scale learned on all other people."""

import numpy as np

from experiments.bennett2013.neura_sparse import person
from experiments.common.recordings import available, names, walks
from experiments.common.row import Row, show
from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf import PAPER
from jgait.types import RecordingError, as_float


def rows(quick: bool) -> list[Row]:
    """`walking5m`: every recording gives a distance or a named reason; one scale learned on all other people."""
    if not available("walking5m"):
        return []
    loaded = walks("walking5m", names("walking5m")[:3] if quick else None)
    reasons = [[failure.name, failure.reason] for failure in loaded.failures]
    found: list[tuple[str, str, float, float, float]] = []
    for walk in loaded:
        name = walk.recording.name
        if walk.reference is None:
            reasons.append([name, f"no reference: {walk.info['no_reference']}"])
            continue
        try:
            ours = leg_ekf.estimate(person(walk), walk.recording)
            theirs = leg_ekf.estimate(person(walk), walk.recording, PAPER)
        except RecordingError as error:
            reasons.append([name, str(error)])
            continue
        true = float(as_float(walk.reference.distance)[-1])
        found.append((name, walk.recording.subject, true, float(ours.distance[-1]), float(theirs.distance[-1])))
    subjects = np.array([f[1] for f in found])
    true, ours, theirs = (np.array([f[k] for f in found]) for k in (2, 3, 4))
    default, paper = (100.0 * (leave_one_out(subjects, true, v) / true - 1.0) for v in (ours, theirs))
    constant = 100.0 * (leave_one_out(subjects, true, np.ones_like(true)) / true - 1.0)
    show(
        "walking5m: distance with one scale learned on the other people",
        ["recording", "foot trajectories [m]", "error %, default", "error %, paper's pipeline"],
        [[f[0], f[2], float(d), float(q)] for f, d, q in zip(found, default, paper, strict=True)],
    )
    if reasons:
        show("walking5m: not used", ["recording", "reason"], reasons)
    split, line = "leave one subject out", "default, scale learned on other people: distance error"
    n = len(found)
    return [
        Row("walking5m_loso_distance_mae_pct", float(np.mean(np.abs(default))), "%", n=n, split=split).on(
            line, "mean", "people"
        ),
        Row("walking5m_loso_distance_median_pct", float(np.median(np.abs(default))), "%", n=n, split=split).on(
            line, "median", "people"
        ),
        Row("walking5m_loso_distance_worst_pct", float(np.max(np.abs(default))), "%", n=n, split=split).on(
            line, "worst", "people"
        ),
        Row("walking5m_loso_paper_mae_pct", float(np.mean(np.abs(paper))), "%", n=n, split=split),
        Row("walking5m_loso_constant_mae_pct", float(np.mean(np.abs(constant))), "%", n=n, split=split),
        Row("walking5m_not_used", float(len(reasons)), "recordings", n=n + len(reasons), split=split),
    ]


def leave_one_out(subjects: np.ndarray, true: np.ndarray, raw: np.ndarray) -> np.ndarray:
    """Each distance times the median scale of all other subjects."""
    return np.array([raw[k] * np.median((true / raw)[subjects != subjects[k]]) for k in range(raw.size)])
