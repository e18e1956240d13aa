"""The records: what is not there is named, arguments of other kinds are refused, and all are printed briefly."""

import importlib
import inspect
import pkgutil
import typing
from operator import sub

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pandas as pd
import pytest

import jgait
from jgait import evaluate, io, simulate, tune
from jgait.estimators import foot_ins
from jgait.notes import Kind, brief
from jgait.params import positive
from jgait.types import (
    Imu,
    Legs,
    LegTrajectory,
    Recording,
    Scalar,
    as_float,
    leg_of,
    numbered_people,
    people,
)

KEY, EMPTY = jax.random.key(0), Recording({}, 100.0)


def trajectory(offset):
    return LegTrajectory(*(jnp.arange(3.0) + offset + k for k in range(4)))


def test_leg_of_gives_the_side_asked_for_and_names_what_is_not_there():
    legs = Legs(right=trajectory(0.0), left=trajectory(10.0))
    assert leg_of(legs, "right") is legs.right
    assert leg_of(legs, "left") is legs.left
    with pytest.raises(ValueError, match=r"^the left leg was not measured$"):
        leg_of(legs._replace(left=None), "left")
    for side in ("Right", ""):
        with pytest.raises(ValueError, match=rf"^side must be 'right' or 'left'; got {side!r}$"):
            leg_of(legs, side)


@pytest.mark.parametrize("values", [[1, 2], (1.0, 2.0), np.asarray([1, 2], np.int16), np.asarray([1, 2], np.float32)])
def test_host_arrays_are_float64(values):
    array = as_float(values)
    assert array.dtype == np.float64
    np.testing.assert_array_equal(array, [1.0, 2.0])


def test_a_person_has_one_name_however_it_is_written():
    written = ["Anna", "anna ", 1, "1", np.int64(1), "NA", " ANNA"]
    assert people(written) == ["Anna", "Anna", "1", "1", "1", "NA", "Anna"]
    composed, decomposed = "Ren\u00e9", "Rene\u0301"
    assert people([composed, decomposed, f" {decomposed.upper()}"]) == [composed] * 3
    assert people(["Anna M", "anna  m", "annam"]) == ["Anna M", "Anna M", "annam"]
    names, number = numbered_people(np.array(["b", "A", "B ", "a"]))
    assert names == ("b", "A") and list(number) == [0, 1, 0, 1]
    for nobody in (None, float("nan")):
        with pytest.raises(ValueError, match="every row needs a subject; 1 of 2 have none"):
            people(["nan", nobody])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: jgait.analyse(3), r"recording must be a jgait.types.Recording, .*; got int 3"),
        (lambda: jgait.analyse(EMPTY, 1.75), r"person must be a dictionary of measures, .*; got 1.75"),
        (lambda: foot_ins.estimate(foot_ins.FootParams(), [EMPTY]), r"recording must be .*; got list"),
        (lambda: foot_ins.estimate(EMPTY, foot_ins.FootParams()), r"must be parameters, FootParams; got Recording"),
        (lambda: evaluate.cohort(foot_ins.estimator(), EMPTY), r"several walks in a list; got one Recording"),
        (lambda: evaluate.cohort(foot_ins.estimator(), [EMPTY]), r"items must be walks, .*; item 0 is Recording"),
        (lambda: tune.lessons(foot_ins.estimator(), [EMPTY]), r"walks must be jgait.types.Walk.*; got Recording"),
        (lambda: io.read(3), r"path must be the path of a file, such as 'walk.csv'; got int 3"),
        (lambda: io.read_csv(pd.DataFrame({"t": [0.0]})), r"recording_from_dataframe takes tables in memory; got"),
        (lambda: io.write_csv("walk.csv", EMPTY), r"path must be the path of a file, .*; got Recording"),
        (lambda: simulate.straight("8"), r"length of a piece of a route must be a number; got str '8'"),
        (lambda: simulate.straight(np.ones(2)), r"length of a piece of a route must be a number; got an array"),
        (lambda: simulate.route(8.0), r"a piece of a route must be a dictionary, .*; got float 8.0"),
        (lambda: simulate.population(0, 3), r"key must be a random key of JAX, such as jax.random.key\(0\); got int 0"),
        (lambda: simulate.population(np.ones(3), 3), r"key must be a random key .*; got an array of float64"),
        (lambda: tune.fit(sub, 1.0, positive, np.ones(3), optax.adam(0.1), key=0), r"key must be a random key"),
        (lambda: tune.fit(sub, 1.0, positive, np.ones(3), optax.adam(0.1), steps=3.5), r"steps must be a whole number"),
        (lambda: tune.fit(sub, 1.0, None, np.ones(3), optax.adam(0.1)), r"transforms must hold a .*; got None"),
        (lambda: simulate.population(KEY, "3"), r"n must be a whole number; got str '3'"),
        (lambda: simulate.covering(KEY, "me", simulate.straight(8.0)), r"person must be a jgait.simulate.Person; got"),
        (lambda: simulate.covering(KEY, simulate.Person(), 8.0), r"along must be a Route, .*; got float 8.0"),
        (lambda: simulate.recording(KEY, along=8.0), r"along must be a Route, .*; got float 8.0"),
        (lambda: simulate.recording(KEY, errors="mpu6000"), r"errors must be ImuErrors, .*; got str 'mpu6000'"),
        (lambda: simulate.recording(KEY, rate="100"), r"rate must be a number of samples per second; got str '100'"),
        (lambda: simulate.gait(speed="1.3", cadence=110.0), r"speed must be a number; got str '1.3'"),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("unchecked")
def test_an_argument_of_another_kind_is_named_with_what_was_expected(call, message):
    with pytest.raises(TypeError, match=message):
        call()


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("placements", ["foot_right", []])
def test_sensors_are_a_list_of_places(placements):
    with pytest.raises(ValueError, match=r"placements must be one or more names in a list"):
        simulate.recording(KEY, placements=placements)


def test_a_gait_in_other_units_is_refused():
    with pytest.raises(ValueError, match=r"speed must be above 0 and at most 13; got 130"):
        simulate.gait(speed=130, cadence=110.0)


def public_records():
    """The classes of records that are public names of jgait, or that its public functions return."""
    found = [jgait.__name__, *(found.name for found in pkgutil.walk_packages(jgait.__path__, "jgait."))]
    modules = [importlib.import_module(name) for name in found if not name.startswith("jgait.commands")]
    public = [getattr(module, name) for module in modules for name in getattr(module, "__all__", ())]
    known = {each for each in public if inspect.isclass(each)}
    for function in filter(inspect.isfunction, public):
        if "return" in function.__annotations__ and not isinstance(function.__annotations__["return"], str):
            known.add(typing.get_origin(function.__annotations__["return"]) or function.__annotations__["return"])
    known -= {jgait.Recording, jgait.Analysis, tune.Lessons}  # which print a sentence of their contents
    return sorted((each for each in known if getattr(each, "_fields", ())), key=lambda each: each.__name__)


def filled(kind):
    """A record with large arrays where a field can hold arrays or records, and a number elsewhere."""
    plain = (bool, int, float, str)
    large = np.linspace(0.0, 1.0, 3000).reshape(1000, 3)
    return kind(*(1 if hint in plain or hint == Scalar else large for hint in kind.__annotations__.values()))


@pytest.mark.parametrize("kind", public_records(), ids=lambda kind: kind.__name__)
def test_every_record_is_printed_in_ten_lines(kind):
    shown = repr(filled(kind))
    assert 1 <= len(shown.splitlines()) <= 10
    assert len(shown) <= 1200


def test_a_record_shows_what_it_holds():
    imu = Imu(np.arange(500.0), np.zeros((500, 3)), None, np.ones(500, bool))
    assert repr(imu) == "Imu(time=float64[500], gyr=float64[500, 3], mask=bool[500])"
    assert "<th>gyr</th><td>float64[500, 3]</td>" in imu._repr_html_()
    walk = jgait.Walk(Recording({"waist": imu}, 100.0), None, {"day": "<b>"})
    assert repr(walk).startswith("Walk(recording=Recording('recording': 500 samples; 100 Hz; sensors waist; 0 notes), ")
    assert "&lt;b&gt;" in walk._repr_html_()
    assert brief({"height": 1.75, "thigh_length": (0.4, 0.41)}) == "{height: 1.75, thigh_length: 2 [0.4, 0.41]}"
    assert repr(Kind("late", "check", "{s:.1f} s late", "")(s=0.1)) == "Note(late, check: 0.1 s late)"
    assert repr(jax.jit(lambda given: given)(imu._replace(acc=jnp.zeros((500, 3))))).startswith("Imu(time=float64[500]")
