"""What the ankle experiment finds on real legs: every stride, exchanged sensors, and lengths held out."""

import numpy as np
import pytest

from experiments.common import shanks as legs
from experiments.silva2017 import detect, groups, lengths, methods, routes

pytestmark = pytest.mark.release


def test_every_stride_of_the_reference_walk_and_its_length(data):
    data("neura_sparse")
    found = legs.legs("neura_sparse")
    for half_steps in (False, True):
        scores = [detect.score(leg, detect.strides_of(leg).end, half_steps=half_steps) for leg in found]
        assert detect.f1(scores) == 1.0
    for group, limit in (("neura_ankle", 1.5), ("neura_shank", 3.5)):
        of = [leg for leg in found if leg.group == group]
        s = lengths.stacked([lengths.signals(leg) for leg in of])
        told, fits = methods.held_out(s, groups.keys("neura", of), "3-D")
        assert lengths.errors(told, s).mae_cm < limit
        assert all(0.0 < fit.height < 0.3 for fit in fits)
        bare = lengths.errors(lengths.lengths("3-D", lengths.with_lever(0.0), lengths.CUTOFF_HZ, s), s)
        assert bare.mae_cm > lengths.errors(told, s).mae_cm


def test_exchanged_sensors_are_noticed_without_their_names(data):
    walks = {walk.recording.name for walk in data("walking5m")}
    wanted = tuple(sorted(walks & {"Elderly/20180417_2", "Elderly/20180403_3"}))
    if len(wanted) < 2:
        pytest.skip("the recordings with and without exchanged sensors are not here")
    found = legs.legs("walking5m", wanted)
    noticed = [(leg.walk, leg.side) for leg in found if leg.notes]
    assert noticed == [("Elderly/20180417_2", "left")]
    assert detect.f1([detect.score(leg, detect.strides_of(leg).end, half_steps=True) for leg in found]) == 1.0


def test_the_papers_tables_from_known_counts_and_distances(capsys):
    true, far = np.array([30, 40, 50]), np.full(3, 42.05)
    counts = {way.title: true.copy() for way in routes.COUNTS}
    counts["Jiménez"] = true + [3, -2, 10]
    ways = {way.title: far.copy() for way in routes.DISTANCES}
    ways["filter"] = 1.01 * far
    ways["Li 2-D"] = far * [0.9, 0.95, 1.0]
    found = [routes.Measured(f"route B, {pace}", true, far, counts, ways, np.full(3, 0.04)) for pace in routes.PACES]
    rows = {row.metric: row for row in routes.cohort_table(found)}
    assert rows["sim_count_error_pct"].value == rows["sim_distance_error_pct"].value == 0.0
    assert rows["sim_count_jimenez_error_pct"].value == pytest.approx(35.0 / 3.0)
    assert rows["sim_count_jimenez_error_pct_max"].value == pytest.approx(20.0)
    assert rows["sim_distance_filter_error_pct"].value == pytest.approx(1.0)
    assert rows["sim_distance_li_error_pct"].value == pytest.approx(5.0) and rows["sim_distance_li_error_pct"].n == 6
    two = {row.metric: row for row in routes.table_one(found, [0, 1]) + routes.table_two(found, [0, 1])}
    assert two["sim_two_count_jimenez_error_pct"].value == pytest.approx(7.5)  # 10 % of A's, 5 % of B's
    assert two["sim_two_distance_li_error_pct"].value == pytest.approx(7.5)
    assert two["sim_two_distance_li_error_pct"].paper == pytest.approx((5.7 + 11.1) / 2.0)
    said = capsys.readouterr().out
    assert "+3 -2" in said and "-4.20 -10.0%" in said
