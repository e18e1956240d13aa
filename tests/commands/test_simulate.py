"""`jgait simulate`: what it writes, what it refuses, and that it makes nothing twice."""

import json

import numpy as np
import pandas as pd
import pytest
from made.command import run

from jgait import io

SMALL = [
    "simulate",
    "--people",
    "2",
    "--route",
    "straight:4",
    "--placements",
    "thigh_right,shank_right",
    "--rate",
    "50",
]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("made")
    return run(*SMALL, "--out", out, "--json", out / "told.json"), out


def test_writes_recordings_with_their_truth_and_a_table_for_evaluate(made):
    (code, said), out = made
    assert code == 0, said
    cohort = pd.read_csv(out / "cohort.csv")
    told = json.loads((out / "told.json").read_text())["walks"]
    assert list(cohort["file"]) == ["subject_0001.csv", "subject_0002.csv"]
    for _, row in cohort.iterrows():
        # Thighs are 0.245, the fifth lumbar vertebra about 0.6 of the body height.
        assert row["sensor_height_m"] == pytest.approx(0.6 / 0.245 * row["thigh_length_m"], rel=0.08)
        recording = io.read_csv(out / row["file"])
        assert set(recording.sensors) == {"thigh_right", "shank_right"}
        truth = pd.read_csv(out / row["file"].replace(".csv", "_truth.csv"))
        assert len(truth) == len(recording.sensors["thigh_right"].time)
        np.testing.assert_allclose(truth["distance_m"].iloc[-1], row["distance_m"], atol=0.05)  # it sways as it stands
        strides = pd.read_csv(out / row["reference_strides"])
        known = io.reference_from_tables(recording.sensors["thigh_right"].time, truth, strides)
        assert None not in known.feet and np.ptp(known.feet.left.position[:, 0]) == pytest.approx(4.0, rel=0.1)
        assert told[row["subject"]]["strides"] == len(pd.read_csv(out / row["file"].replace(".csv", "_strides.csv")))


def test_the_same_again_writes_nothing_anew_and_another_simulation_is_refused(made):
    _, out = made
    kept = {file: file.stat().st_mtime_ns for file in out.glob("subject_*")}
    (out / "subject_0002.csv").unlink()
    assert run(*SMALL, "--out", out)[0] == 0
    again = {file: file.stat().st_mtime_ns for file in out.glob("subject_*")}
    assert [file.name for file in kept if kept[file] != again[file]] == ["subject_0002.csv"]
    code, said = run(*SMALL, "--out", out, "--seed", 1)
    assert code == 2 and "seed was “0”, now “1”" in said


def test_people_of_two_seeds_have_different_names(made, tmp_path):
    assert run(*SMALL, "--seed", 3, "--out", tmp_path)[0] == 0
    cohorts = [pd.read_csv(folder / "cohort.csv") for folder in (made[1], tmp_path)]
    assert list(cohorts[1]["subject"]) == ["subject_0001_seed3", "subject_0002_seed3"]
    assert all((tmp_path / file).exists() for file in cohorts[1][["file", "reference_samples"]].to_numpy().ravel())
    assert not set(cohorts[0]["subject"]) & set(cohorts[1]["subject"])
    assert not np.isclose(cohorts[0]["thigh_length_m"], cohorts[1]["thigh_length_m"]).any()


def test_people_walk_in_the_gait_that_is_asked_for(made, tmp_path):
    assert run(*SMALL, "--gait", "shuffling", "--out", tmp_path)[0] == 0
    usual, shuffled = (
        pd.read_csv(folder / "subject_0001_strides.csv")["stride_length_m"].median() for folder in (made[1], tmp_path)
    )
    assert shuffled < 0.5 * usual
