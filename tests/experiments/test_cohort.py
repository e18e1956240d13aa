"""The experiment on the cohort measures what it says: walks come back from disk, and comparing finds a change."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.cohort import report, same, walks
from jgait import evaluate
from jgait.estimators import leg_ekf
from jgait.simulate import FOUR

pytestmark = pytest.mark.release

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three walks of six seconds."""
    made = tmp_path_factory.mktemp("walks")
    assert walks.simulated(made, 5, 0, 3, (6.0, 6.5)) == []
    return made


@pytest.fixture(scope="module")
def tables(folder):
    names = sorted(path.stem for path in folder.glob("*.npz"))
    estimator = leg_ekf.estimator(leg_ekf.PAPER)
    return evaluate.cohort(estimator, names, read=lambda name: walks.read(str(folder), name), body=walks.leg_lengths)


def test_walks_come_back_as_they_were_made(folder):
    (one,) = (entry for entry in walks.walkers(5, 1, 2, (6.0, 6.5)))
    walk = walks.read(str(folder), one.name)
    assert one.name == "00001_corner"
    assert tuple(walk.recording.sensors) == FOUR
    assert walk.recording.subject == "subject_00001"
    truth, body = walk.reference, one.person.body
    assert walk.info == pytest.approx({"thigh_length": body.thigh_length, "shank_length": body.shank_length})
    assert truth.time[-1] == pytest.approx(one.seconds, abs=0.0101) and 5.5 < one.seconds < 8.0
    assert truth.distance[-1] - truth.distance[0] == pytest.approx(float(np.sum(one.along.length)), rel=1e-5)
    # The legs close: the ankle is where the angles put it.
    for leg in truth.legs:
        shank = leg.hip_angle - leg.knee_angle
        x = body.thigh_length * np.sin(leg.hip_angle) + body.shank_length * np.sin(shank)
        np.testing.assert_allclose(leg.x, x, atol=0.02)
    still = truth.time < 0.5
    for imu in walk.recording.sensors.values():
        assert imu.gyr.dtype == np.float32 and imu.mask.mean() > 0.9
        assert np.linalg.norm(imu.acc[still & imu.mask], axis=1) == pytest.approx(9.81, rel=0.1)
    assert truth.strides.valid.all()
    assert len(truth.strides.length) == pytest.approx(one.person.gait.steps + 1)


def test_the_quality_that_is_reported(tables):
    rows = {row.metric: row.value for row in report.quality(tables, "here")}
    distance = tables.quantities.query("quantity == 'distance_m'")["rel_error"].abs()
    assert rows["distance_error_worst_pct"] == pytest.approx(100.0 * distance.max())
    assert rows["failures_pct"] == 0.0
    # First and last strides at least, and few others.
    steps = tables.strides.groupby("recording").size()
    assert rows["strides_not_compared_pct"] >= 100.0 * 3 * len(steps) / steps.sum() - 1e-9
    lost = tables._replace(failures=pd.DataFrame({"recording": ["a"], "subject": ["a"], "reason": ["no walking"]}))
    assert {r.metric: r.value for r in report.quality(lost, "here")}["failures_pct"] == 25.0


def test_the_comparison_finds_every_change(tables):
    difference = same.difference
    assert difference(tables, tables) == 0.0

    def changed(table, row, column, value):
        whole = getattr(tables, table).copy()
        whole.loc[row, column] = value
        return tables._replace(**{table: whole})

    value = tables.quantities.loc[3, "estimate"]
    assert difference(changed("quantities", 3, "estimate", value * (1.0 + 1e-7)), tables) == pytest.approx(
        1e-7, rel=1e-6
    )
    assert difference(tables, changed("strides", 5, "start", 0.0)) == 1.0
    for table, row, column, value in (
        ("quantities", 3, "estimate", np.nan), ("strides", 5, "side", "both"), ("recordings", 0, "notes", "new"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=f"{table} differ in .*{column}"):
            difference(changed(table, row, column, value), tables)
    with pytest.raises(ValueError, match="strides differ"):
        difference(tables._replace(strides=tables.strides.iloc[1:]), tables)
