"""Trajectories of both feet for the stride width filter, and the filter's result merged into them; NumPy."""

import numpy as np

from jgait.estimators import foot_ins
from jgait.estimators.checks import not_bridged, sensors_of
from jgait.estimators.foot_ins.params import FootOptions, FootParams
from jgait.estimators.notes import LONGEST_LOSS
from jgait.estimators.stride_width_ekf.trajectories import SHORTEST_WAY
from jgait.geometry.rotation import turned, yawed
from jgait.signal.windows import true_runs
from jgait.types import SIDES, Estimate, Feet, Flags, FootTrajectory, Recording, RecordingError, Strides, as_float


def feet_of(
    recording: Recording, p: FootParams, options: FootOptions
) -> tuple[Estimate, tuple[np.ndarray, np.ndarray]]:
    """The `foot_ins` estimate of both feet, and the samples of their footholds. Raises RecordingError if a foot has no
    sensor, or as `foot_ins.estimate`.
    """
    missing = [f"foot_{side}" for side in SIDES if f"foot_{side}" not in recording.sensors]
    if missing:
        wanted = " and ".join(repr(name) for name in missing)
        raise RecordingError(f"stride_width_ekf needs {wanted}; {sensors_of(recording)}")
    feet = foot_ins.estimate(p, recording, options)
    right, left = (feet.diagnostics[f"footholds_{side}"] for side in SIDES)
    return feet, (right, left)


def measured_only(estimate: Estimate, recording: Recording, stances: tuple[np.ndarray, np.ndarray]) -> Feet:
    """The feet with NaN from the foothold before a long loss of samples to the one after it: how a foot moves between
    them is not known.
    """
    assert estimate.feet is not None
    time, feet = np.asarray(estimate.time, np.float64), []
    for side, foot, mids in zip(SIDES, estimate.feet, stances, strict=True):
        lost = not_bridged(~np.asarray(recording.sensors[f"foot_{side}"].mask, bool), time, LONGEST_LOSS)
        unknown = np.zeros(time.size, bool)
        for first, after in true_runs(lost):
            unknown[max(mids[mids < first], default=-1) + 1 : min(mids[mids >= after], default=time.size)] = True
        assert foot is not None
        feet.append(foot._replace(position=np.where(unknown[:, None], np.nan, foot.position)))
    return Feet(*feet)


def merged(alone: Estimate, stances: tuple[np.ndarray, np.ndarray], together: Estimate) -> Estimate:
    """The `foot_ins` estimate with both feet in one world frame, and with stride widths.

    The trajectories of `alone`, whose footholds are the samples `stances`, are moved to the footholds of `together`,
    stride by stride; its strides get width and step length, its diagnostics are joined.
    """
    feet = Feet(*(_placed(alone, side, mids, together) for side, mids in zip(SIDES, stances, strict=True)))
    matches = _matches(alone.strides, together.strides)

    def with_widths(table: Strides, other: Strides) -> Strides:
        # a stride without a row of the filter takes what is behind the last one
        width, step = (np.append(as_float(column), np.nan)[matches] for column in (other.width, other.step_length))
        return table._replace(width=width, step_length=step)

    trusted = np.append(np.asarray(together.diagnostics["width_valid"], bool), False)[matches]
    trusted &= ~_at_doubtful_footholds(alone.strides, alone.diagnostics["doubtful"])
    diagnostics = {
        **alone.diagnostics, **together.diagnostics, "moment_time": np.asarray(together.time), "width_valid": trusted,
    }  # fmt: skip
    return alone._replace(
        feet=feet, strides=with_widths(alone.strides, together.strides),
        strides_stddev=with_widths(alone.strides_stddev, together.strides_stddev), diagnostics=diagnostics,
    )  # fmt: skip


def _placed(alone: Estimate, side: str, mids: np.ndarray, together: Estimate) -> FootTrajectory:
    """One foot's trajectory; each stride is rotated and scaled to start and end at the footholds of `together`."""
    assert alone.feet is not None
    assert together.feet is not None
    trajectory, common = getattr(alone.feet, side), getattr(together.feet, side).position
    time, position = alone.time, np.array(trajectory.position, np.float64)
    velocity, orientation = (np.array(part, np.float64) for part in (trajectory.velocity, trajectory.orientation))
    here = position[:, 0] + 1j * position[:, 1]
    there = np.interp(time[mids], together.time, common[:, 0]) + 1j * np.interp(time[mids], together.time, common[:, 1])
    factor = np.ones(max(len(mids) - 1, 1), complex)
    for k, (way, wanted) in enumerate(zip(np.diff(here[mids]), np.diff(there), strict=True)):
        # where a direction is not known: the rotation of the previous stride
        known = min(abs(way), abs(wanted)) > SHORTEST_WAY
        factor[k] = wanted / way if known else (factor[k - 1] if k else 1.0)
    stride = np.clip(np.searchsorted(mids, np.arange(len(time)), side="right") - 1, 0, len(factor) - 1)
    placed = there[stride] + (here - here[mids][stride]) * factor[stride]
    turn = np.angle(factor)[stride]
    position = np.stack([placed.real, placed.imag, position[:, 2]], axis=1)
    return FootTrajectory(position, turned(velocity, turn), yawed(orientation, turn))


def _matches(ours: Strides, theirs: Strides) -> np.ndarray:
    """(n,) row of the filter for each stride, −1 for none."""
    middle, side = 0.5 * (as_float(ours.standing) + as_float(ours.standing_end)), np.asarray(ours.side)
    inside = (as_float(theirs.standing) < middle[:, None]) & (middle[:, None] < as_float(theirs.standing_end))
    inside &= (side[:, None] == np.asarray(theirs.side)) & np.asarray(theirs.valid, bool)
    return np.max(np.where(inside, np.arange(inside.shape[1]), -1), axis=1, initial=-1)


def _at_doubtful_footholds(strides: Strides, doubtful: Flags) -> np.ndarray:
    """(n,) bool, strides that begin or end at a foothold of a doubtful stride, or pass one of the other foot."""
    side, begin, end = (
        np.asarray(column)[:, None] for column in (strides.side, strides.standing, strides.standing_end)
    )
    rows = np.flatnonzero(doubtful)
    places = np.concatenate([begin[rows, 0], end[rows, 0]])
    same, passed = (begin == places) | (end == places), (begin < places) & (places < end)
    return np.where(side == np.tile(side[rows, 0], 2), same, passed).any(axis=1)
