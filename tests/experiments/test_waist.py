"""The waist's experiment: what is learned on whom, the gradient, and a real bout."""

from types import SimpleNamespace

import numpy as np
import pytest

from jgait.estimators import waist

pytestmark = pytest.mark.release


@pytest.fixture(scope="module")
def parts(load_experiment):
    names = ("walks", "contacts", "distances", "tables", "ofdri")
    return SimpleNamespace(**{name: load_experiment(f"kose2011.{name}") for name in names})


def made(parts, contacts, subject="one", **changes):
    """A walk of which only the reference is known; right and left in turn."""
    contacts = np.asarray(contacts, float)
    windows = parts.walks.Windows(np.array([[1.0, 9.0]]), np.array([[0.0, 9.5]]))
    pieces = parts.walks.Pieces(np.array([[1.0, 5.0], [5.0, 9.0]]), np.array([4.0, 4.0]))
    walk = parts.walks.Walk(
        "mobgap_lab", "made", subject, None, {}, contacts, np.arange(contacts.size) % 2, windows, windows, pieces,
        np.nan,
    )  # fmt: skip
    return walk._replace(**changes)


def measured_as(parts, per_constant, integrated=0.9):
    """A stand-in for the estimator: distance in proportion to K, or a number of its own."""

    def measured(p, item, options):
        free = getattr(options, "distance", options) in ("fused", "pendulum")
        ratio = p.pendulum_constant * per_constant[item.walk.name] if free else integrated
        return parts.distances.Measured(ratio, np.zeros(2), 0.06, np.nan, np.nan)

    return measured


def test_the_constant_is_learned_on_others(parts, monkeypatch):
    walks = [
        made(parts, [1.0], "a", name="1"), made(parts, [1.0], "a", name="2"), made(parts, [1.0], "b", name="3"),
        made(parts, [1.0], "c", name="4", set="ipol_gait"),
    ]  # fmt: skip
    items = [parts.distances.Item(walk, None) for walk in walks]
    per = {"1": 1.0, "2": 0.25, "3": 0.8, "4": 0.5}
    monkeypatch.setattr(parts.distances, "measured", measured_as(parts, per))
    way = parts.distances.WAYS[0]
    assert parts.distances.held_out(way, items, same_set=True) is None  # nobody else in the set of the last
    same = parts.distances.held_out(way, items[:3], same_set=True)
    # K of a is the geometric mean of 1 and 4; b's is 1.25
    np.testing.assert_allclose([one.ratio for one in same], [1.25, 0.3125, 1.6])
    other = parts.distances.held_out(way, items, same_set=False)
    of_lab = np.sqrt(2.0 * 1.25)
    np.testing.assert_allclose([one.ratio for one in other], [2.0, 0.5, 1.6, 0.5 * of_lab])
    assert parts.distances.within(same, items[:3])["_straight"].tolist() == [False, False, False]
    ofi = parts.distances.held_out(parts.distances.WAYS[-1], items, same_set=True)
    np.testing.assert_allclose(parts.distances.errors(ofi, items)["mobgap_lab"], -10.0)
    assert parts.distances.within(ofi, items)[""].tolist() == [True] * 4


def test_what_the_papers_way_makes_of_a_known_walk(parts):
    """Speed 1 m/s reached at once, 0.2 m/s more half way: kept by ε of 0.1, taken for drift by that of 0.3."""
    dt, samples = 0.01, 2001
    acc = np.zeros(samples)
    acc[50:150] = 1.0
    acc[1050:1070] = 1.0
    rights = 0.25 + np.arange(20)
    speed = np.concatenate([[0.0], np.cumsum(0.5 * dt * (acc[1:] + acc[:-1]))])
    way = float(np.sum(0.5 * dt * (speed[1:] + speed[:-1])))
    walk = made(parts, rights, sides=np.zeros(20, int), total=way)
    one = parts.tables.Simulated(walk, acc, dt)
    assert abs(parts.tables.true_error(one, "update", 0.1)) < 1e-9
    lost = parts.tables.true_error(one, "update", 0.3)
    # 0.2 m/s are missing from the rise on, up to where the last cycle ends and integration goes on
    assert lost == pytest.approx(-100.0 * 0.2 * 9.5 / way, rel=0.05)
    np.testing.assert_allclose(parts.tables.speed_changes(one).max(), 0.2, rtol=1e-6)


def test_gradient(parts):
    rows = {row.metric: row.value for row in parts.ofdri.rows(True)}
    assert rows["ofdri_gradient_error"] < 1e-6
    assert rows["ofdri_value_and_gradient_ms"] > 0.0


def test_a_real_bout(parts, data):
    """Contacts are those that users get, and the pendulum is proportional to its constant."""
    data("mobgap_lab")
    walks = [walk for walk in parts.walks.of_set("mobgap_lab", quick=True) if walk.name in parts.walks.QUICK[:1]]
    if not walks:
        pytest.skip("the short walk of HA/001 is not here")
    (walk,) = walks
    found = parts.contacts.detected(walk)
    s = parts.contacts.score([walk], [found])
    assert s.f1 == 1.0 and s.sides == 100.0 and s.plain < 40.0
    (item,) = parts.distances.ready([walk])
    p = waist.WaistParams()
    k = parts.distances.constants(p, [item])[0]
    assert 1.1 < k < 1.6
    again = parts.distances.measured(p._replace(pendulum_constant=k), item, parts.distances.PENDULUM)
    assert again.ratio == pytest.approx(1.0, abs=1e-9)
    assert 0.0 < again.deviation < 0.2
    told = parts.distances.run(waist.with_body(p, walk.body), item.inputs, parts.distances.PENDULUM).diagnostics
    rows = np.flatnonzero(told["initial_contact_valid"])
    np.testing.assert_array_equal(np.asarray(told["initial_contact"])[rows], found.time)
    np.testing.assert_array_equal(np.asarray(told["initial_contact_side"])[rows], found.side)
