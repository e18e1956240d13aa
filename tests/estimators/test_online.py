"""Estimators sample by sample: equal to the filter over the whole walk, whatever the blocks; gaps; what is refused."""

import jax
import numpy as np
import pytest
from made.estimators import altered, hidden, only, times

import jgait
from experiments.silva2017.online import table, walk
from jgait import simulate
from jgait.estimators import duty_cycled_gyro, leg_ekf
from jgait.estimators.ankle_stride import AnkleParams
from jgait.estimators.ankle_stride import online as ankle_online
from jgait.estimators.duty_cycled_gyro import DutyCycledOptions
from jgait.estimators.foot_ins import FootOptions, FootParams, prepared
from jgait.estimators.foot_ins import online as foot_online
from jgait.estimators.foot_ins.estimator import filtered
from jgait.estimators.online import duty, legs
from jgait.estimators.online.device import BLOCK
from jgait.estimators.online.legs import KINEMATICS, SETTLES_S, START_VARIANCE
from jgait.estimators.online.samples import LONGEST_GAP_S, Pushes
from jgait.geometry.rotation import level
from jgait.geometry.vectors import GRAVITY
from jgait.simulate.sensors import MPU6000, OPAL
from jgait.types import RecordingError

PERSON = {"height": 1.75}
ANGLES = ("hip_angle", "knee_angle", "x", "y")


@pytest.fixture(scope="module")
def walked():
    route = simulate.straight(7.0)
    ((recording, truth),) = simulate.cohort(jax.random.key(11), 1, route, OPAL, 100.0, simulate.SEVEN, recorded=False)
    return recording, truth


def signals_of(recording, placements):
    sensors = recording.sensors
    return np.asarray(sensors[placements[0]].time), {
        name: (np.array(sensors[name].gyr), np.array(sensors[name].acc)) for name in placements
    }


def pushed(live, time, signals, size=10):
    """The news of a whole walk, pushed in blocks."""
    return [
        live.push(time[k : k + size], {name: (gyr[k : k + size], acc[k : k + size])
                                       for name, (gyr, acc) in signals.items()})
        for k in range(0, len(time), size)
    ]  # fmt: skip


def table_of(news, source):
    """Strides of a whole walk, with deviations and flags."""
    return jax.tree.map(lambda *v: np.concatenate(v), *(one.strides[source] for one in news))


def lengths(news, source):
    return table_of(news, source).strides.length


def joined(news, part, side="right"):
    legs = [getattr(getattr(one, part), side) for one in news]
    return jax.tree.map(lambda *v: np.concatenate(v), *legs)


def test_angles_and_distance_are_those_of_the_filter(walked):
    live = jgait.online(walked[0], PERSON, "leg_ekf")
    news = pushed(live, *signals_of(walked[0], live.placements))
    own = leg_ekf.with_body(leg_ekf.LegParams(), PERSON)
    made = leg_ekf.prepared(walked[0], KINEMATICS)
    stands = np.concatenate([one.stands for one in news])
    assert not stands[:50].any()
    assert stands[60:90].all()
    assert 0.1 < stands.mean() < 0.6
    inputs = made.inputs._replace(still=stands, start_variance=np.asarray(START_VARIANCE))
    offline = jax.jit(leg_ekf.run, static_argnames=("options",))(own, inputs, options=made.options)
    for side in ("right", "left"):
        for part, other in (("legs", offline.legs), ("stddev", offline.stddev)):
            for field in ANGLES:
                mine = getattr(joined(news, part, side), field)
                np.testing.assert_allclose(mine, getattr(getattr(other, side), field), rtol=0.0, atol=1e-6)
    distance = [one.distance["legs"] for one in news[:-1]]
    np.testing.assert_allclose(distance, offline.distance[9::10][: len(distance)], rtol=1e-6, atol=1e-9)


def test_angles_are_valid_after_standing_or_when_they_have_settled(walked):
    """A stream that begins in walking, and a long loss of a shank."""
    recording, truth = walked
    time, signals = signals_of(recording, jgait.online(recording, PERSON, "leg_ekf").placements)
    first = int(np.flatnonzero(truth.estimate.distance > 1.3)[0])
    lost = slice(first, first + 100)
    for begin in (0, first):
        live = jgait.online(recording, PERSON, "leg_ekf")
        parts = {name: (gyr[begin:].copy(), acc[begin:]) for name, (gyr, acc) in signals.items()}
        if begin == 0:
            parts["shank_right"][0][lost] = np.nan
        news = pushed(live, time[begin:], parts)
        valid, stands = (np.concatenate([getattr(one, name) for one in news]) for name in ("valid", "stands"))
        again = begin + (0 if begin else lost.stop)  # from here on angles are unknown
        stood = np.flatnonzero(stands[again - begin :])
        known = min(stood[0] if stood.size else len(time), round(SETTLES_S * 100.0))
        assert not valid[again - begin : again - begin + known - 1].any()
        assert valid[again - begin + known + 1 :].all()
        if begin == 0:
            assert valid[60 : first + 25].all() and not valid[first + 35 : lost.stop].any()
        for side in ("right", "left"):
            true, mine = getattr(truth.estimate.legs, side).knee_angle[begin:], joined(news, "legs", side).knee_angle
            off = np.abs(mine - true) / joined(news, "stddev", side).knee_angle
            assert off[again - begin :][valid[again - begin :]].max() < 3.0


@pytest.mark.release
def test_sleeping_gyroscopes_give_valid_angles_after_standing_alone(walked):
    live = jgait.online(walked[0], PERSON, "duty_cycled_gyro")
    time, signals = signals_of(walked[0], live.placements)
    news = pushed(live, time, signals)
    valid, stands = (np.concatenate([getattr(one, name) for one in news]) for name in ("valid", "stands"))
    np.testing.assert_array_equal(valid, np.cumsum(stands) > 0)


def test_a_stride_of_a_foot_that_seems_to_stand_in_a_slow_swing_is_in_doubt():
    varied = {"length_variability": 0.06, "time_variability": 0.05, "usual": simulate.RECORDED}
    key, way = jax.random.key(1), simulate.straight(5.0)
    person = simulate.covering(key, simulate.Person(gait=simulate.gait(speed=0.4, stride_length=0.7, **varied)), way)
    recording, truth = simulate.recording(key, person, way, errors=MPU6000, placements=("foot_right", "foot_left"))
    live = jgait.online(only(recording, "foot_right"))
    found = table_of(pushed(live, *signals_of(recording, live.placements)), "feet")
    true = truth.strides.length[np.asarray(truth.strides.valid) & (truth.strides.side == 0)]
    wrong = np.abs(found.strides.length - true) > 0.1
    assert wrong.any() and found.flags["doubtful"].sum() <= 2
    assert found.flags["doubtful"][wrong].all()


@pytest.mark.release
def test_angles_with_sleeping_gyroscopes_are_those_of_the_filter_that_holds(walked):
    recording = walked[0]
    live = jgait.online(recording, PERSON, "duty_cycled_gyro")
    time, signals = signals_of(recording, live.placements)
    on = (np.arange(len(time)) % 40 < 25) | (time < 3.0)
    for side in ("right", "left"):
        signals[f"shank_{side}"][0][~on] = np.nan
    news = pushed(live, time, signals)
    options = DutyCycledOptions(filler="hold")
    own = duty_cycled_gyro.with_body(duty_cycled_gyro.params_of(options), PERSON)
    gyro_on = {f"shank_{side}": on for side in ("right", "left")}
    whole, made = duty_cycled_gyro.prepared(recording, options), duty_cycled_gyro.prepared(recording, options, gyro_on)

    def asleep(leg, all_on):
        # mounting from the whole recording, as calibrated
        shank = all_on.shank._replace(on=on, gyr=np.where(on, all_on.shank.gyr, 0.0))
        return leg._replace(shank=shank, thigh=all_on.thigh)

    stands = np.concatenate([one.stands for one in news])
    inputs = made.inputs._replace(
        right=asleep(made.inputs.right, whole.inputs.right), left=asleep(made.inputs.left, whole.inputs.left),
        still=stands, start_variance=np.asarray(0.1),
    )  # fmt: skip
    offline = jax.jit(duty_cycled_gyro.run, static_argnames=("options",))(own, inputs, options=made.options)
    for side in ("right", "left"):
        for field in ANGLES:
            mine = getattr(joined(news, "legs", side), field)
            np.testing.assert_allclose(mine, getattr(getattr(offline.legs, side), field), rtol=0.0, atol=1e-6)
    mine = np.concatenate([one.angles["shank_right"] for one in news])
    np.testing.assert_allclose(mine, offline.diagnostics["angle_shank_right"], rtol=0.0, atol=1e-6)


def test_strides_of_feet_are_those_of_the_filter(walked, feet):
    """The filter over the whole walk, at the stances and footholds that were detected sample by sample."""
    (recording, truth), news = walked, feet[1]
    time, signals = signals_of(recording, ("foot_right", "foot_left"))
    own = FootParams()
    mounting = foot_online.worn(own, recording, "right")
    gyr, acc = signals["foot_right"]
    start = foot_online.begin(own, mounting, gyr[0], acc[0])
    now = jax.jit(foot_online.over)(own, mounting, start, gyr, acc)[1]
    late = foot_online.lag(mounting)
    stands, foothold = (np.append(np.asarray(v)[late:], np.zeros(late, bool)) for v in (now.stands, now.instant))
    first = int(np.argmax(stands))
    around = np.arange(first + late + 1 - start.detector.samples.shape[0], first + late + 1)
    up = acc[np.maximum(around, 0)].mean(axis=0)
    up = up / np.linalg.norm(up)
    inputs = prepared(recording).inputs.right
    samples = np.arange(len(time))
    # at the first sample the change is half that to the second, since the foot is taken to have been at rest
    jumps = [np.linalg.norm(np.gradient(np.append(v[:1], v, axis=0), axis=0)[1:], axis=1) for v in (gyr, acc)]
    largest = [np.append(np.full(2, own_jump[:3].max()), offline[2:]) for own_jump, offline in
               zip(jumps, (inputs.gyr_jump, inputs.acc_jump), strict=True)]  # fmt: skip
    foot = inputs._replace(
        stands=stands, restart=np.append(0.0, foothold[:-1].astype(float)), valid=samples >= first,
        dt=np.where(samples > first, 0.01, 0.0), attitude=level(up), up=up, acc_bias=mounting.acc_bias * up,
        features=np.zeros((len(time), 1)), gyr_doubt=np.zeros(len(time)), acc_doubt=np.zeros(len(time)),
        gyr_jump=largest[0], acc_jump=largest[1],
    )  # fmt: skip
    found = jax.jit(lambda p, one: filtered(p, one, options=FootOptions(smooth=False)))(own, foot)
    at = np.flatnonzero(foothold)
    way = np.asarray(found.mean.position)[at].T
    offline = np.hypot(way[0], way[1])
    offline, rise = offline[offline > 0.1], way[2][offline > 0.1]
    mine = jax.tree.map(lambda v: v[table_of(news, "feet").strides.side == 0], table_of(news, "feet").strides)
    assert len(mine.length) >= 4
    np.testing.assert_allclose(mine.length, offline, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(mine.height, rise, rtol=0.0, atol=1e-6)
    assert_near_the_truth(news, "feet", truth, 0.03)


def assert_near_the_truth(news, source, truth, largest):
    """Every true stride is there, with its length, contacts and a deviation of the right size."""
    (rows, stddev, _), true, valid = table_of(news, source), truth.strides, np.asarray(truth.strides.valid)
    assert len(rows.end) == valid.sum()
    found = []
    for side, end, length in zip(rows.side, rows.end, rows.length, strict=True):
        apart = np.where(valid & (np.asarray(true.side) == side), np.abs(np.asarray(true.end) - end), np.inf)
        assert apart.min() < 0.3
        found.append(length - true.length[int(np.argmin(apart))])
    assert np.mean(np.abs(found)) < largest
    assert np.mean((found / stddev.length) ** 2) < 3.0


def test_strides_of_shanks_are_those_of_the_whole_walk(walked):
    recording, truth = walked
    live = jgait.online(recording, PERSON, "ankle_stride")
    assert live.sources == ("shanks",)
    time, signals = signals_of(recording, live.placements)
    news = pushed(live, time, signals, size=17)
    own = live_params(AnkleParams())
    for number, side in enumerate(("right", "left")):
        mounting = ankle_online.worn(own, recording, side)
        whole = walk(own, mounting, *signals[f"shank_{side}"])
        mine = lengths(news, "shanks")[table_of(news, "shanks").strides.side == number]
        np.testing.assert_allclose(mine, table(whole)[0].length, rtol=0.0, atol=1e-6)
    assert_near_the_truth(news, "shanks", truth, 0.05)
    assert news[-1].distance["shanks"] == pytest.approx(float(truth.estimate.distance[-1]), rel=0.05)


@pytest.mark.parametrize(
    ("estimator", "source", "worn"), [("ankle_stride", "shanks", "shank"), ("foot_ins", "feet", "foot")]
)
def test_strides_that_contradict_a_leg_that_stands_are_in_doubt(walked, estimator, source, worn):
    live = jgait.online(walked[0], PERSON, estimator)
    time, signals = signals_of(walked[0], live.placements)
    loose = time > np.median(time)
    signals[f"{worn}_right"][1][loose, 0] += 4.0 * np.sign(np.sin(9.0 * time[loose]))  # m/s²: the sensor shakes
    strides, stddev, flags = table_of(pushed(live, time, signals), source)
    shakes = (strides.side == 0) & (strides.end > time[loose][0])
    wide = flags["doubtful"] | (stddev.length > 2.0 * np.median(stddev.length[~shakes]))
    assert shakes.sum() > 2 and wide[shakes].mean() > 0.6
    assert not flags["doubtful"][~shakes].any()


def live_params(p):
    return jgait.estimators.get("ankle_stride").with_body(p, {"height": PERSON["height"]})


@pytest.fixture(scope="module")
def feet(walked):
    live = jgait.online(walked[0], PERSON, "foot_ins")
    return walked[0], pushed(live, *signals_of(walked[0], live.placements))


def test_blocks_of_any_size_give_the_same_and_the_memory_is_constant(feet):
    recording, news = feet
    live = jgait.online(recording, PERSON, "foot_ins")
    time, signals = signals_of(recording, live.placements)
    size, k, other = 0, 0, []
    for count in (1, 2, BLOCK + 3, 5 * BLOCK, len(time)):
        here = slice(k, min(k + count, len(time)))
        k = here.stop
        other.append(live.push(time[here], {name: (g[here], a[here]) for name, (g, a) in signals.items()}))
        assert size in (0, live.state_bytes)
        size = live.state_bytes
    assert k == len(time)
    assert 0 < size < 8000
    np.testing.assert_allclose(lengths(other, "feet"), lengths(news, "feet"), rtol=0.0, atol=1e-9)
    contacts = [np.concatenate([one.contacts.time for one in every]) for every in (news, other)]
    assert len(contacts[0]) == 2 * len(lengths(news, "feet"))
    np.testing.assert_allclose(np.sort(contacts[0]), np.sort(contacts[1]), atol=1e-9)


def test_a_gap_is_bridged_and_a_long_one_costs_its_strides_alone(feet):
    recording, news = feet
    live = jgait.online(recording, PERSON, "foot_ins")
    time, signals = signals_of(recording, live.placements)
    kept = np.ones(len(time), bool)
    kept[505:510] = False  # never sent
    for gyr, _ in signals.values():
        gyr[700:703] = np.nan  # sent, and lost
    parts = {name: (gyr[kept], acc[kept]) for name, (gyr, acc) in signals.items()}
    bridged = pushed(live, time[kept], parts)
    np.testing.assert_allclose(lengths(bridged, "feet"), lengths(news, "feet"), atol=0.25)
    assert sum(len(one.time) for one in bridged) == kept.sum()

    again = pushed(live, time + time[-1] + 100.0, signals)  # of the pause only a part is bridged
    assert live._clock._samples < 2 * len(time) + (LONGEST_GAP_S + 1.0) * 100.0
    ends, before = (table_of(one, "feet").strides.end for one in (again, news))
    assert len(ends) == len(before)
    np.testing.assert_allclose(ends - time[-1] - 100.0, before, atol=0.05)


@pytest.mark.parametrize("stuck", [True, False], ids=["stuck", "lost"])
def test_the_distance_is_that_of_the_intact_foot(feet, walked, stuck):
    live = jgait.online(feet[0], PERSON, "foot_ins")
    time, signals = signals_of(feet[0], live.placements)
    gyr, acc = signals["foot_left"]
    gyr[:], acc[:] = (0.0, acc[50]) if stuck else (np.nan, np.nan)
    last = pushed(live, time, signals)[-1]
    assert last.distance["feet"] == pytest.approx(float(walked[1].estimate.distance[-1]), rel=0.03)
    assert last.lost == {"feet": 0.0}


def test_seconds_without_any_foot_are_told(feet):
    live = jgait.online(feet[0], PERSON, "foot_ins")
    time, signals = signals_of(feet[0], live.placements)
    for gyr, _ in signals.values():
        gyr[500:650] = np.nan
        gyr[800:810] = np.nan
    lost = [one.lost["feet"] for one in pushed(live, time, signals)]
    assert lost[49] == 0.0 and lost[59] == pytest.approx(1.0)
    assert lost[-1] == pytest.approx(1.51)


@pytest.mark.parametrize(
    ("time", "change", "message"),
    [
        (2.0, {"foot_left": None}, r"push needs the samples of foot_left, foot_right; got \['foot_right'\]"),
        (2.0, {"waist": (np.zeros(3), np.zeros(3))}, "push needs the samples of foot_left, foot_right; got"),
        (2.0, {"foot_left": (np.zeros(4), np.zeros(3))}, r"gyr of 'foot_left' must have the shape \(3,\); got \(4,\)"),
        (2.0, {"foot_left": np.zeros(6)}, r"the samples of 'foot_left' must be \(gyr, acc\); got ndarray"),
        (0.5, {}, "time must increase; 0.5 s follows 1 s"),
        (np.nan, {}, "time must be one finite number"),
        ([1.5, 1.4], {}, "time must increase; 1.4 s follows 1.5 s"),
        ([2.0, 2.1, 2.2, 2.3, 2.4], {}, "samples come at 10 Hz; the calibration has 100 Hz"),
    ],
    ids=["missing", "more", "shape", "pair", "backwards", "nan", "inside", "rate"],
)
def test_wrong_samples_are_refused_and_change_nothing(walked, time, change, message):
    live = jgait.online(walked[0], PERSON, "foot_ins")
    count = np.shape(time)
    good = {name: (np.zeros((*count, 3)), np.full((*count, 3), 5.6)) for name in live.placements}
    live.push(1.0, {name: (np.zeros(3), np.full(3, 5.6)) for name in live.placements})
    bad = {name: value for name, value in {**good, **change}.items() if value is not None}
    with pytest.raises(ValueError, match=message):
        live.push(time, bad)
    assert live.push(1.01, {name: (np.zeros(3), np.full(3, 5.6)) for name in live.placements}).time.tolist() == [1.01]


@pytest.mark.parametrize(
    ("size", "change", "message"),
    [
        (7, lambda gyr, acc: (np.degrees(gyr), acc), r"gyr of 'foot_left' must be in rad/s; .* is it in deg/s\?$"),
        (5000, lambda gyr, acc: (gyr, acc / GRAVITY), r"acc of 'foot_left' must be in m/s²; .* is it in g\?$"),
        (7, lambda gyr, acc: (acc, gyr), "gyr and acc of 'foot_left' seem to be exchanged"),
    ],
    ids=["deg/s", "g", "exchanged"],
)
def test_other_units_are_refused(walked, size, change, message):
    live = jgait.online(walked[0], PERSON, "foot_ins")
    time, signals = signals_of(walked[0], live.placements)
    signals["foot_left"] = change(*signals["foot_left"])
    with pytest.raises(ValueError, match=message):
        pushed(live, time, signals, size)


def test_a_flight_phase_jolts_and_lost_samples_are_no_other_unit():
    pushes = Pushes(("foot_left",), 100.0)
    gyr, acc = np.zeros((400, 3)), np.full((400, 3), GRAVITY / np.sqrt(3.0))
    acc[150:190], gyr[200:205], acc[200:205], gyr[300:], acc[300:] = 0.0, 200.0, 200.0, np.nan, np.nan
    for k in range(400):
        pushes.accept(pushes.block(0.01 * k, {"foot_left": (gyr[k], acc[k])}))
    assert pushes.block(4.0 + 0.01 * np.arange(400), {"foot_left": (gyr, acc)}).samples == 800


@pytest.mark.parametrize(
    ("names", "error", "message"),
    [
        ("waist", ValueError, "waist has no form sample by sample: its contacts come from wavelets"),
        (("stride_width_ekf",), ValueError, "stride_width_ekf has no form sample by sample"),
        ("pedometer", ValueError, "estimators online are foot_ins, ankle_stride, leg_ekf, duty_cycled_gyro; got"),
        (("leg_ekf", "duty_cycled_gyro"), ValueError, "give the same angles: take one of them"),
        ("duty_cycled_gyro", ValueError, "parameter 'thigh_length.right' must lie in"),
    ],
    ids=["waist", "width", "unknown", "twice", "long thigh"],
)
def test_what_has_no_form_sample_by_sample_or_no_leg_has_is_refused(walked, names, error, message):
    with pytest.raises(error, match=message):
        jgait.online(walked[0], {"thigh_length": 3.0}, names)


def test_a_recording_that_does_not_walk_cannot_calibrate(walked):
    recording = walked[0]
    still = altered(recording, gyr=lambda v: 0.0 * v, acc=lambda v: 0.0 * v + np.array([0.0, 0.0, 9.81]))
    feet = only(still, "foot_right", "foot_left")
    with pytest.raises(RecordingError, match="a recording of walking is needed to know how 'foot_right' is worn"):
        jgait.online(feet)
    with pytest.raises(RecordingError, match="online there are feet, ankles, shanks, and thighs with shanks"):
        jgait.online(only(recording, "pelvis"))
    with pytest.raises(RecordingError, match="ankle_stride has no sensors; the recording has"):
        jgait.online(feet, estimators="ankle_stride")


@pytest.mark.parametrize(("of", "p"), [(legs, leg_ekf.LegParams()), (duty, duty_cycled_gyro.DutyCycledParams())])
def test_what_a_mask_hides_in_the_calibration_is_used_nowhere(walked, of, p):
    """A tenth of a second of standing, and some of each stride, of a shank."""
    recording = walked[0]
    lost = np.arange(len(times(recording))) % 150 <= 10
    one, other = (of.device(p, hidden(recording, lost, "shank_right", value=v))[0].constants for v in (0.0, 20.0))
    jax.tree.map(np.testing.assert_array_equal, one, other)
