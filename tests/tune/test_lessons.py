"""From walks to lessons: what is resampled, padded, stacked and refused, and what is minimised over them."""

import jax
import numpy as np
import pytest
from made import cohort as made_cohort

from jgait import params, tune
from jgait.tune.lessons import resampled
from jgait.tune.losses import TrajectoryWeights
from jgait.types import RecordingError, Walk


def body(walk: Walk) -> dict[str, float]:
    return {"offset": 0.1 * walk.info["number"]}


@pytest.fixture(scope="module")
def made():
    return tune.lessons(made_cohort.FAKE, [made_cohort.walk(i) for i in (1, 2, 3)], body=body)


def test_walks_of_different_length_are_stacked_with_their_references(made):
    walks = [made_cohort.walk(i) for i in (1, 2, 3)]
    sizes = [walk.reference.time.size for walk in walks]
    assert made.names == ("walk_001", "walk_002", "walk_003")
    assert made.subjects == ("001", "002", "003")
    assert made.failures == ()
    assert {np.shape(leaf)[0] for leaf in jax.tree.leaves(made.data)} == {3}
    assert made.data.look.shape == (3, max(sizes))
    assert made.data.reference.valid.sum(axis=1).tolist() == sizes
    assert made.data.look.sum(axis=1).tolist() == sizes
    for number, walk in enumerate(walks):
        one = made.lesson(number)
        np.testing.assert_array_equal(one.reference.distance[: sizes[number]], walk.reference.distance)
        np.testing.assert_array_equal(one.inputs.time[: sizes[number]], walk.reference.time)
        assert (int(one.first), int(one.last)) == (0, sizes[number] - 1)
        assert one.body["offset"] == pytest.approx(0.1 * walk.info["number"])
        strides = int(walk.reference.strides.valid.sum())
        assert int(one.reference.strides.valid.sum()) == strides
        assert not one.reference.strides.length[walk.reference.strides.length.size :].any()
    assert set(made.data.reference.diagnostics) == {"offset"}


def test_a_walk_has_what_the_losses_ask_for_or_is_refused_in_words():
    whole = made_cohort.walk(1)
    kept = tune.asked(whole, ["stride_length"]).reference
    assert kept.strides is whole.reference.strides and kept.feet is None and kept.legs == (None, None)
    bare = whole._replace(reference=whole.reference._replace(distance=None))
    assert np.isnan(tune.asked(bare, ["stride_length"]).reference.distance).all()
    assert tune.asked(whole, ["likelihood"]).reference is None
    with pytest.raises(RecordingError, match="position needs a reference with feet"):
        tune.asked(whole, ["stride_length", "position"])


def test_one_bad_walk_costs_no_other():
    walks = [made_cohort.walk(1), made_cohort.walk(2, "misplaced"), made_cohort.walk(3)]
    walks += [made_cohort.walk(5)._replace(reference=None)]
    found = tune.lessons(made_cohort.FAKE, walks)
    assert found.names == ("walk_001", "walk_003")
    reasons = dict(found.failures)
    assert reasons["walk_002"] == "needs 'foot_right'; the recording has ['waist']"
    assert "no reference" in reasons["walk_005"]


def test_what_does_not_stack_with_most_is_named():
    odd = made_cohort.walk(7)  # at 200 Hz the options differ
    bare = made_cohort.walk(4)
    bare = bare._replace(reference=bare.reference._replace(distance=None))
    reasons = dict(tune.lessons(made_cohort.FAKE, [made_cohort.walk(1), odd, bare, made_cohort.walk(2)]).failures)
    assert "options is True here, False there" in reasons["walk_007"]
    assert "it lacks reference.distance" in reasons["walk_004"]


def test_without_references_all_can_be_used():
    walks = [made_cohort.walk(1), made_cohort.walk(2)._replace(reference=None)]
    found = tune.lessons(made_cohort.FAKE, walks, reference=False)
    assert found.names == ("walk_001", "walk_002")
    assert found.data.reference is None


def test_nothing_to_learn_from():
    with pytest.raises(ValueError, match="no walk to learn from: walk_001: needs 'foot_right'"):
        tune.lessons(made_cohort.FAKE, [made_cohort.walk(1, "misplaced")])
    with pytest.raises(
        ValueError, match=r"learn from: walk_001 and 2 others: needs 'foot_right'; the recording has \['waist'\]$"
    ):
        tune.lessons(made_cohort.FAKE, [made_cohort.walk(i, "misplaced") for i in (1, 2, 3)])
    with pytest.raises(ValueError, match="no walk to learn from: there are none"):
        tune.lessons(made_cohort.FAKE, [])


def test_a_reference_at_other_times_is_linear_and_valid_between_valid_samples():
    truth = made_cohort.walk(1).reference
    valid = np.ones(truth.time.size, bool)
    valid[100] = False
    found = resampled(truth._replace(valid=valid), [-0.5, 0.0, 0.005, 0.995, 1.02, truth.time[-1] + 1e-9, 99.0])
    assert found.valid.tolist() == [False, True, True, False, True, True, False]
    assert found.distance[2] == pytest.approx(0.5 * (truth.distance[0] + truth.distance[1]), rel=1e-12)
    assert found.legs.left.x[2] == pytest.approx(0.5 * (np.sin(0.0) + np.sin(0.01)), rel=1e-12)


def test_terms_are_weighted_and_summed(made):
    one, p = made.lesson(0), made_cohort.FAKE.params
    estimate = made_cohort.run(made_cohort.with_body(p, one.body), one.inputs, made.options)
    way, true = (np.asarray(d)[int(one.last)] - np.asarray(d)[0] for d in (estimate.distance, one.reference.distance))
    percent = 100.0 * (way / true - 1.0)

    def loss(terms):
        return float(tune.objective(made_cohort.FAKE, made.options, terms)(p, one))

    assert loss("distance") == pytest.approx(percent**2, rel=1e-12)
    assert loss("distance_percent") == pytest.approx(abs(percent), rel=1e-12)
    assert loss({"distance": 0.5, lambda estimate, lesson: lesson.body["offset"]: 2.0}) == pytest.approx(
        0.5 * percent**2 + 0.2, rel=1e-12
    )
    rms = np.sqrt(loss("trajectory") / len(TrajectoryWeights._fields))
    assert loss("trajectory_rms") == pytest.approx(rms, rel=1e-12)


def test_the_likelihood_is_the_sum_over_the_legs(made):
    def run(p, inputs, options):
        told = {"log_likelihood_right": inputs.speed[0], "log_likelihood_left": p.scale, "nis_right": p.scale}
        return made_cohort.run(p, inputs, options)._replace(diagnostics=told)

    one, p = made.lesson(0), made_cohort.FAKE.params
    loss = tune.objective(made_cohort.FAKE._replace(run=run), made.options, "likelihood")
    assert float(loss(p, one)) == pytest.approx(-(one.inputs.speed[0] + p.scale), rel=1e-12)
    with pytest.raises(ValueError, match="tells no log-likelihood"):
        tune.objective(made_cohort.FAKE._replace(run=made_cohort.run), made.options, "likelihood")(
            p, one._replace(inputs=one.inputs)
        )


def test_terms_that_are_not_known_and_weights_that_are_none():
    with pytest.raises(ValueError, match="distance, trajectory, joint_angles.* trajectory_rms, or functions"):
        tune.objective(made_cohort.FAKE, None, "speed")
    with pytest.raises(ValueError, match="terms must be among"):
        tune.objective(made_cohort.FAKE, None, {})
    for weight in (-1.0, 0.0, np.nan, np.inf):
        with pytest.raises(ValueError, match=f"the weight of 'distance' must be a positive number; got {weight}"):
            tune.objective(made_cohort.FAKE, None, {"distance": weight})


def test_equal_objectives_are_one_to_what_keeps_programs():
    one, other = (tune.objective(made_cohort.FAKE, ("a",), "distance") for _ in range(2))
    assert one == other and hash(one) == hash(other)


def test_a_fit_finds_the_scale_of_the_lessons(made):
    import optax

    free = params.freed(made_cohort.FAKE.transforms, "scale")
    loss = tune.objective(made_cohort.FAKE, made.options, "distance")
    fit = tune.fit(loss, made_cohort.Params(), free, made.data, optax.adam(0.05), steps=60, subjects=made.subjects)
    assert fit.best_loss < 0.05 * fit.losses[0]
    assert fit.params.offset == made_cohort.Params().offset
