"""Cross-validation: each subject is judged by a fit that never saw them, and nothing leaks."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from made import cohort as made_cohort

from jgait import tune
from jgait.params import fixed, per_subject, real


class Centre(NamedTuple):
    x: Any
    own: Any = 0.0


def square(p, item):
    return (p.x + p.own - item) ** 2


PEOPLE = ["a", "a", "b", "c", "c", "d"]
DATA = np.array([1.0, 2.0, 4.0, 7.0, 9.0, 12.0])
ONLY = Centre(real, fixed)
FAST = optax.sgd(0.25)


def run(loss=square, **change):
    call = {"params": Centre(0.0), "transforms": ONLY, "data": DATA, "optimizer": FAST, "subjects": PEOPLE, "steps": 60}
    return tune.cross_validate(loss, **(call | change))


def others(name):
    return DATA[[one != name for one in PEOPLE]].mean()


def test_each_subject_is_judged_by_the_mean_of_the_others():
    found = run()
    assert list(found.table.index) == ["a", "b", "c", "d"]
    for name, row in found.table.iterrows():
        own = DATA[[one == name for one in PEOPLE]]
        assert row["n"] == own.size
        assert row["error_before"] == pytest.approx(np.mean(own**2))
        assert row["error_after"] == pytest.approx(np.mean((own - others(name)) ** 2))
        assert row["change"] == row["error_after"] - row["error_before"]
    np.testing.assert_allclose(found.params.x, [others(name) for name in "abcd"])
    assert found.losses.shape == (4, 1) and not found.left_out.any()
    apart = run(error=lambda p, item: jnp.abs(p.x - item))
    assert apart.table.loc["d", "error_after"] == pytest.approx(12.0 - others("d"))


def test_it_equals_a_loop_over_fits():
    found = run(starts=3, spread=2.0, key=jax.random.key(0), steps=7)
    for fold, name in enumerate("abcd"):
        inside = [one != name for one in PEOPLE]
        one = tune.fit(
            square, Centre(0.0), ONLY, DATA[inside], FAST, steps=7, starts=3, spread=2.0, key=jax.random.key(0)
        )
        assert float(one.params.x) == pytest.approx(found.params.x[fold], rel=1e-12)
        assert one.best_loss == pytest.approx(found.losses[fold].min(), rel=1e-10)


def test_groups_of_fits_change_nothing(monkeypatch):
    from jgait.tune import descent

    whole = run(starts=3, spread=2.0, key=jax.random.key(0), steps=7)
    monkeypatch.setattr(descent, "AT_ONCE", 30)  # five fits of six items at once; twelve in all
    parts = run(starts=3, spread=2.0, key=jax.random.key(0), steps=7)
    np.testing.assert_allclose(parts.losses, whole.losses, rtol=1e-12)
    np.testing.assert_allclose(parts.params.x, whole.params.x, rtol=1e-12)


def test_subjects_are_dealt_to_folds_whole():
    found = run(folds=2, key=jax.random.key(1))
    assert sorted(found.table["fold"].value_counts()) == [2, 2]
    for _, part in found.items.groupby("subject"):
        assert part["fold"].nunique() == 1
    for fold, part in found.items.groupby("fold"):
        rest = DATA[[i not in set(part["item"]) for i in range(DATA.size)]].mean()
        np.testing.assert_allclose(part["error_after"], (DATA[part["item"]] - rest) ** 2)
        assert fold in (0, 1)


def test_known_values_of_each_subject_are_used_and_unknown_ones_refused():
    known = Centre(0.0, np.array([1.0, 2.0, 3.0, 4.0]))
    found = run(params=known, transforms=Centre(real, per_subject(fixed)))
    shifted = DATA - np.array([1.0, 1.0, 2.0, 3.0, 3.0, 4.0])
    assert found.table.loc["b", "error_after"] == pytest.approx((2.0 - np.delete(shifted, 2).mean()) ** 2)
    with pytest.raises(ValueError, match="a subject's own parameters cannot be learned from others"):
        run(transforms=Centre(real, per_subject(real)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"folds": [0, 1, 1, 2, 2, 3]}, "the split leaks 1 of 4 subjects: a is in folds 0, 1"),
        ({"folds": [0] * 6}, "at least two folds; got one"),
        ({"folds": [0, 1]}, "6 subjects and 2 folds"),
        ({"folds": 5, "key": jax.random.key(0)}, "folds must be between 2 and the 4 subjects; got 5"),
        ({"folds": 2}, "which subjects share a fold is drawn: give key"),
        ({"subjects": ["a"] * 6}, "at least two folds; got one"),
        ({"subjects": ["a", "b"]}, "one label for each of the 6 items; got 2"),
        (
            {"data": np.array([1.0, 2.0, 1.0, 7.0, 9.0, 12.0])},
            "items 0 and 2 are the same recording, of subjects a and b",
        ),
    ],
)
def test_leaks_and_misuse_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        run(**change)


def test_one_recording_of_two_people_is_found_whatever_their_measures_and_references():
    made = tune.lessons(made_cohort.FAKE, [made_cohort.walk(1), made_cohort.walk(2)])
    own = {"leg": np.arange(4.0)}
    both = jax.tree.map(lambda leaf: leaf[[0, 0, 0, 1]], made.data)
    far = both.reference.distance * np.array([[1.0], [1.1], [1.2], [1.3]])
    both = both._replace(body=own, reference=both.reference._replace(distance=far))
    with pytest.raises(ValueError, match="the split leaks: items 0 and 2 are the same recording, of subjects a and c"):
        tune.cross_validate(
            lambda p, lesson: p.x**2, Centre(1.0), ONLY, both, FAST, subjects=["a", "a", "c", "d"], steps=1
        )


def test_a_person_has_one_name_however_it_is_written():
    names = ["Anna", "anna ", "b", 1, "1", "d"]
    found = run(subjects=names)
    assert list(found.table.index) == ["Anna", "b", "1", "d"] and list(found.table["n"]) == [2, 1, 2, 1]
    np.testing.assert_array_equal(found.table.to_numpy(), run().table.to_numpy())
    with pytest.raises(ValueError, match="every row needs a subject; 2 of 6 have none"):
        run(subjects=["a", None, "b", float("nan"), "c", "d"])


def test_a_bad_recording_costs_nobody_else():
    data = np.where(np.arange(6) == 2, np.nan, DATA)
    with pytest.warns(UserWarning, match=r"1 of 6 items were left out: .* \(items 2\)"):
        found = run(data=data)
    assert np.isnan(found.table.loc["b", "error_after"])
    assert found.table.loc["d", "error_after"] == pytest.approx((12.0 - DATA[[0, 1, 3, 4]].mean()) ** 2)
    assert list(found.left_out) == [1, 0, 1, 1]


def test_it_goes_on_where_it_was_killed(tmp_path):
    class Cut(Exception):
        pass

    def cut(now):
        if now.done >= 20:
            raise Cut

    file = tmp_path / "folds.npz"
    with pytest.raises(Cut):
        run(checkpoint_file=file, progress=cut, chunk=5)
    resumed, whole = run(checkpoint_file=file, chunk=5), run()
    assert np.array_equal(resumed.losses, whole.losses)
    assert resumed.table.equals(whole.table)
    with pytest.raises(ValueError, match="belongs to another fit: folds differ"):
        run(checkpoint_file=file, folds=[0, 0, 1, 1, 1, 1], chunk=5)
    other = tmp_path / "other.npz"
    run(checkpoint_file=other, chunk=5)
    with pytest.raises(ValueError, match="belongs to another fit: loss differ"):
        run(lambda p, item: 2.0 * square(p, item), checkpoint_file=other, chunk=5)


def test_parts_of_the_fits_are_put_together(tmp_path):
    whole = run(starts=2, key=jax.random.key(0))
    for number in range(1, 5):
        assert run(starts=2, key=jax.random.key(0), part=(number, 4), checkpoint_file=tmp_path / "folds.npz") is None
    joined = run(starts=2, key=jax.random.key(0), checkpoint_file=tmp_path / "folds.npz")
    np.testing.assert_allclose(joined.losses, whole.losses, rtol=1e-12)
    np.testing.assert_allclose(joined.table["error_after"], whole.table["error_after"], rtol=1e-12)
    assert joined.fit.params.x == pytest.approx(whole.fit.params.x, rel=1e-12)
