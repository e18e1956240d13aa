"""The waist's experiment: how contacts and strides are matched, what is learned on whom, and a walk of each kind."""

from types import SimpleNamespace

import numpy as np
import pytest

from jgait import datasets
from jgait.estimators import waist
from jgait.types import Imu, Recording, Strides

pytestmark = pytest.mark.release


@pytest.fixture(scope="module")
def parts(load_experiment):
    names = ("walks", "contacts", "distances", "mobgap", "tables", "ofdri")
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


def test_contacts_and_detections_are_matched_once_and_edges_forgiven(parts):
    walk = made(parts, [0.5, 1.0, 2.0, 3.0, 9.0, 9.3])
    time = np.array([0.55, 1.05, 1.08, 2.05, 5.0, 9.05, 9.7])
    found = parts.contacts.Found(time, np.array([0, 1, 0, 1, 0, 0, 0]))
    one = parts.contacts.matched(walk, found, walk.straight, 0.05)
    # 0.5 and 9.3 are not looked for; 3.0 is missed; 1.08 and 5.0 are none, 9.7 is not judged
    assert (len(one.late), one.missed, one.extra) == (3, 1, 2)
    np.testing.assert_allclose(one.late, 0.05)
    np.testing.assert_array_equal(one.right, [True, False, True])


def test_an_offset_is_that_of_the_other_people(parts):
    times = np.arange(1.0, 9.0, 0.5)
    walks = [made(parts, times, subject) for subject in ("one", "one", "other")]
    founds = [parts.contacts.Found(times + late, np.arange(16) % 2) for late in (0.02, 0.02, 0.06)]
    s = parts.contacts.score(walks, founds)
    assert (s.f1, s.sides, s.n) == (1.0, 100.0, 48)
    assert s.offset == pytest.approx(20.0)
    assert s.mae == pytest.approx(40.0)
    assert s.plain == pytest.approx((20.0 + 20.0 + 60.0) / 3.0)
    alone = parts.contacts.score(walks[:2], founds[:2])
    assert alone.f1 == 1.0 and np.isnan(alone.mae)


def test_strides_between_checked_contacts_only(parts):
    n = 5
    start = np.array([0.4, 1.5, 2.6, 3.7, 1.0])
    end = np.array([1.5, 2.6, 3.75, 4.8, 2.1])
    side = np.array([0, 0, 0, 0, 1])
    valid = np.ones(n, bool)
    strides = Strides(side, start, start, end, np.arange(1.0, 6.0), start, start, valid)
    contacts = np.array([1.5, 2.0, 2.6, 3.7, 4.8])
    found = parts.walks.between_contacts(strides, contacts, np.array([0, 1, 0, 0, 0]), np.array([1.0, 4.0]))
    # the first begins as the foot leaves the ground, the fourth ends behind the part, the left one begins nowhere
    np.testing.assert_allclose(found.length, [2.0, 3.0])
    np.testing.assert_allclose(found.ends, [[1.5, 2.6], [2.6, 3.75]])


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


def test_mobgap_is_given_its_axes_and_measured_between_its_contacts(parts):
    time = np.arange(1200) / 100.0
    imu = Imu(time, np.ones((1200, 3)), np.ones((1200, 3)), np.ones(1200, bool))
    recording = Recording({"lower_back": imu}, 100.0)
    walk = made(parts, [1.0, 2.0], recording=recording, body={"height": 2.0}, set="ipol_gait")
    job = parts.mobgap.job(walk)
    np.testing.assert_array_equal(job["bouts"], [[0, 1000]])
    np.testing.assert_array_equal(job["acc"][0], [1.0, -1.0, -1.0])
    assert job["sensor_height"] == pytest.approx(1.06)
    steps = np.full(10, 0.5)
    answer = {
        "shin_contacts": np.array([50, 150, 250, 350, 450, 550, 650, 750, 850, 950]),
        "shin_step_lengths_ms_all": np.append(steps[:-1], np.nan),
        "shin_bouts": np.zeros(10, int),
        "shin_sides_ullrich": np.arange(10) % 2,
    }
    assert parts.mobgap.ratio(answer, walk, "shin", "ms_all", 0.0) == pytest.approx(0.5)
    assert parts.mobgap.ratio(answer, walk, "shin", "ms_all", -0.2) == pytest.approx(0.5)
    np.testing.assert_allclose(parts.mobgap.found_by(answer, walk, "shin", "ullrich").time[:2], [0.5, 1.5])


def test_absent_mobgap_and_absent_sets_are_named(parts, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(parts.mobgap.peers, "available", lambda _: False)
    assert parts.mobgap.compared({"mobgap_lab": []}) == []
    monkeypatch.setenv(datasets.registry.DATA_DIR_VARIABLE, str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert parts.walks.of_set("ipol_gait") == []
    said = capsys.readouterr().out
    assert "left out: mobgap is absent" in said and "data set 'ipol_gait' is not there" in said


def test_the_threshold_is_learned_on_others(parts):
    errors = np.array([[1.0, -8.0, -9.0], [-7.0, 2.0, 3.0]])
    np.testing.assert_array_equal(parts.tables.learned_threshold(errors), [1, 0, 0])
    table = dict(zip(parts.tables.THRESHOLDS, np.linspace(20.0, 4.0, 9), strict=True))
    told = parts.tables.by_integration(lambda i, kind, eps: table[eps] * (1 + i), 2, quick=False)
    np.testing.assert_allclose(told["update"], [20.0, 40.0])
    np.testing.assert_allclose(told["learned"], [4.0, 8.0])
    np.testing.assert_array_equal(told["epsilon"], parts.tables.THRESHOLDS[-1])


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


def test_wavelets_and_gradient(parts):
    rows = {row.metric: row.value for row in parts.ofdri.wavelets(True) + parts.ofdri.gradient(True)}
    assert rows["swt_parity"] < 1e-12
    assert rows["swt_three_levels_against_ten"] == 0.0
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


def test_where_contacts_are_not_listed_nothing_is_judged(parts):
    time = np.arange(1000) / 100.0
    swings = np.zeros((1000, 3))
    swings[700:720, 1] = 5.0  # a step after the trial, which ends at 6 s
    foot = Imu(time, swings, swings, np.ones(1000, bool))
    contacts, sides = np.array([1.0, 2.0, 3.0, 4.0, 6.0]), np.array([0, 1, 0, 0, 1])
    known = parts.walks.listed(time, {"foot_left": foot}, contacts, sides, 6.0)
    unknown = parts.walks.runs(time, ~known)
    # between two contacts of the right foot, and from the swing to half a second after it
    np.testing.assert_allclose(unknown, [[3.1, 3.9], [7.0, 7.68]], atol=0.011)


def test_a_delay_grows_with_the_step_time(load_experiment):
    unseen = load_experiment("unseen.waist")
    step = np.linspace(0.45, 0.75, 200)
    late = 0.02 + 0.1 * step
    late[::20] += 0.5  # far detections teach nothing
    np.testing.assert_allclose(unseen.delay(late, step), [0.02, 0.1], atol=1e-9)
    errors = unseen.guessed(np.array([10.0, 10.0, 20.0, np.nan]), np.array(["a", "a", "b", "c"]))
    np.testing.assert_allclose(errors, [100.0, 100.0, -50.0, np.nan])


def test_a_scale_of_the_legs_is_that_of_the_other_people(load_experiment):
    legs = load_experiment("unseen.legs")
    true = np.array([4.0, 5.0, 6.0])
    rows = zip("abc", true, strict=True)
    found = [legs.Distances(name, t, (1.25 * t, 0.1 * t), (9.0 - t, 2.0)) for name, t in rows]
    told = {row.metric: row.value for row in legs.of_distances(found)}
    assert told["leg_distance_pct_scaled"] == pytest.approx(0.0) and told["leg_distance_pct"] == pytest.approx(25.0)
    assert told["leg_raw_bias_pct"] == pytest.approx(25.0) and told["leg_distance_correlation"] == pytest.approx(1.0)
    assert told["leg_within_two_sigma_pct"] == 0.0
    # the guess is the median of the others: 5.5 for 4, 5 for 5, 4.5 for 6
    assert told["leg_distance_pct_guess"] == pytest.approx(100.0 * (1.5 / 4.0 + 0.0 + 1.5 / 6.0) / 3.0)
    assert told["kinematic_distance_correlation"] == pytest.approx(-1.0)
    assert told["kinematic_within_two_sigma_pct"] == pytest.approx(100.0)
