"""One record of results: the tables and the totals of an estimate agree with each other."""

import numpy as np
import pytest

from jgait.io import Results
from jgait.types import Estimate, Legs, Strides


@pytest.fixture
def results():
    """Two bouts of walking with sensors at both ankles, of eight and of six strides, five seconds apart."""
    start = np.concatenate([2.0 + 0.5 * np.arange(8), 12.0 + 0.5 * np.arange(6)])
    count = start.size
    nothing = np.full(count, np.nan)
    strides = Strides(
        np.arange(count) % 2, start, start + 0.6, start + 1.0, np.full(count, 1.2), nothing, np.zeros(count),
        np.ones(count, bool), speed=np.full(count, 1.2),
    )  # fmt: skip
    time = np.arange(0.0, 20.0, 0.01)
    way = 1.2 * (np.clip(time - 2.0, 0.0, 4.5) + np.clip(time - 12.0, 0.0, 3.5))
    spread = {"distance_stddev": 0.05 * way[-1:]}
    return Results(Estimate(time, Legs(None, None), None, way, time >= 0.0, spread, strides))


def test_bouts_share_the_distance_and_the_strides(results):
    assert list(results.bouts["n_strides"]) == [8, 6] and list(results.every["wb_id"].unique()) == [0, 1]
    assert results.bouts["distance_m"].sum() == pytest.approx(1.2 * 8.0)
    np.testing.assert_allclose(results.bouts["distance_std_m"], 0.05 * results.bouts["distance_m"])
    np.testing.assert_allclose(results.bouts["cadence_spm"], 120.0)
    estimate = results.estimate
    early = np.interp(estimate.time + 0.4, estimate.time, estimate.distance)  # a step before the first stride
    bouts = Results(estimate._replace(distance=early)).bouts
    np.testing.assert_allclose(bouts["start_s"], [1.6, 11.6], atol=0.02)
    np.testing.assert_allclose(bouts["duration_s"], [4.9, 3.9], atol=0.02)
    assert bouts["distance_m"].sum() == pytest.approx(1.2 * 8.0)


def test_totals_state_what_the_tables_hold(results):
    totals = {total.words: total.text for total in results.totals}
    assert totals["strides"] == f"14, {results.every['regular'].sum()} regular"
    assert totals["walking"] == "8.0 s in 2 bouts" and totals["distance"] == "9.60 ± 0.48 m"
    assert totals["stride length"] == "1.200 m" and totals["cadence"] == "120 steps/min" and "stance" not in totals
    rough = np.where(results.estimate.strides.side == 0, 0.01, 0.08)  # a shoe, and the waist for the other side
    one_shoe = results.estimate._replace(strides_stddev=Strides(*8 * [None])._replace(length=rough))
    assert {total.words: total.text for total in Results(one_shoe).totals}["stride length"] == "1.200 ± 0.057 m"
    distance = results.summary.set_index("measure").loc["distance"]
    assert (distance["mean"], distance["error_std"]) == pytest.approx((9.6, 0.48))


def test_a_contact_that_ends_a_stride_and_begins_the_next_is_there_once(results):
    initial = results.contacts.query("event == 'initial' and side == 'right'")["time_s"]
    assert list(initial) == sorted(set(initial)) == [2.0, 3.0, 4.0, 5.0, 6.0, 12.0, 13.0, 14.0, 15.0]
