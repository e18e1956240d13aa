"""Pictures of a tuning show what was found, and mark what is not determined and what was taken back."""

import jax.numpy as jnp
import numpy as np
import optax
import pytest
from made.models import Pair

from jgait import tune
from jgait.params import fixed, positive, real
from jgait.plot import tuning as plot_tuning

AT, FREE = Pair(0.4, 0.1, 0.05), Pair(real, real, positive)


def total_length(params, item):
    """Sees a1 + rollover_radius only."""
    return 0.5 * ((item - params.a1 - params.rollover_radius) / params.noise) ** 2 + jnp.log(params.noise)


@pytest.fixture(scope="module")
def lengths():
    values = np.random.default_rng(0).normal(size=50)
    return 0.5 + 0.05 * (values - values.mean()) / values.std()


def test_correlations_are_written_in_their_squares_and_what_is_not_determined_is_marked(lengths):
    found = tune.identifiability(total_length, AT, FREE, lengths)
    figure = plot_tuning.correlation(found, title="lengths")
    axis = figure.axes[0]
    np.testing.assert_array_equal(axis.images[0].get_array(), np.abs(found.correlation))
    names = ["a1 *", "rollover_radius *", "noise"]
    assert [label.get_text() for label in axis.get_xticklabels()] == names
    assert [label.get_text() for label in axis.get_yticklabels()] == names
    assert axis.get_xlabel() == "* not determined by these data"
    texts = [[text.get_text() for text in axis.texts[3 * row : 3 * row + 3]] for row in range(3)]
    assert texts == [["1", "−1.00", "0"], ["−1.00", "1", "0"], ["0", "0", "1"]]
    dark = {text.get_text(): text.get_color() for text in axis.texts}
    assert dark["−1.00"] == "white" and dark["0"] == "black"  # readable on their ground


def test_a_profile_is_drawn_with_its_line_and_its_ends(lengths):
    free = FREE._replace(rollover_radius=fixed, noise=fixed)
    found = tune.profile(total_length, AT, free, lengths, "a1", np.linspace(0.37, 0.42, 6), optax.sgd(0.1))
    ends = found.interval(0.95)
    (axis,) = plot_tuning.profile(found).axes
    need = 1.959963984540054**2 / 2.0
    assert axis.get_xlabel() == "a1" and axis.get_ylabel() == "loss above its minimum [nat]"
    assert axis.get_legend().texts[0].get_text() == "95 %: 1.92 nat"
    curve, points, line, *upright = axis.lines
    np.testing.assert_allclose(points.get_ydata(), found.rises)
    np.testing.assert_allclose(line.get_ydata(), need)
    np.testing.assert_allclose([end.get_xdata()[0] for end in upright], ends)
    parabola = 0.5 * ((curve.get_xdata() - 0.4) / 0.05) ** 2 * 50
    np.testing.assert_allclose(curve.get_ydata(), parabola, atol=1e-9)
    flat = tune.profile(
        total_length, AT, Pair(positive, positive, fixed), lengths, "a1", [0.04, 0.2, 0.4], optax.adam(0.05), steps=150
    )
    (axis,) = plot_tuning.profile(flat).axes
    assert [text.get_text() for text in axis.texts] == ["not determined by these data"]


def test_a_training_shows_loss_gradient_and_what_was_taken_back(lengths):
    def cliff(params, item):  # not a number below 0.3
        return jnp.where(params.a1 < 0.3, jnp.nan, (params.a1 - 0.25) ** 2) + 0.0 * item

    free = Pair(real, fixed, fixed)
    fit = tune.fit(cliff, AT, free, lengths, optax.sgd(0.4), steps=12)
    rejected = np.sum(~fit.accepted)
    assert rejected
    figure = plot_tuning.training(fit, title="a cliff")
    above, below = figure.axes
    assert above.get_ylabel() == "loss" and below.get_xlabel() == "step"
    for axis, values in ((above, fit.losses), (below, fit.gradient_norms)):
        line, crosses = axis.lines[:2]
        np.testing.assert_array_equal(line.get_ydata(), values)
        np.testing.assert_array_equal(crosses.get_xdata(), np.flatnonzero(~fit.accepted))
        np.testing.assert_array_equal(crosses.get_ydata(), values[~fit.accepted])
    best = int(above.lines[2].get_xdata()[0])
    labels = ["loss", f"taken back ({rejected})", f"best: step {best}"]
    assert [text.get_text() for text in above.get_legend().texts] == labels
    assert np.append(fit.losses, fit.best_loss)[best] == fit.best_loss


def test_a_training_judged_on_other_items_shows_their_loss_where_it_was_looked_at(lengths):
    free = Pair(real, fixed, fixed)
    fit = tune.fit(total_length, AT._replace(a1=0.2), free, lengths, optax.sgd(1e-4), steps=10,
                   validation=np.arange(50) >= 40, every=5)  # fmt: skip
    figure = plot_tuning.training(fit)
    line, judged, best = figure.axes[0].lines
    assert best.get_xdata()[0] == np.nanargmin(fit.validation) + 1 and best.get_ydata()[0] == np.nanmin(fit.validation)
    assert best.get_zorder() > line.get_zorder() and best.get_markerfacecolor() != line.get_color()  # it is seen
    assert len(line.get_xdata()) == 10
    assert list(judged.get_xdata()) == [5, 10]
    np.testing.assert_array_equal(judged.get_ydata(), fit.validation[[4, 9]])
