"""The losses of tuning as errors of recordings: one table for any estimator, any losses and any parameters."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait.estimators.interface import Estimator
from jgait.evaluate.buckets import program

if TYPE_CHECKING:
    import pandas as pd

    from jgait.tune import Lessons


def judged[P](estimator: Estimator[P, PyTree], p: P, lessons: "Lessons", names: Sequence[str]) -> "pd.DataFrame":
    """The error of every lesson in each of the losses `names`, with parameters `p`.

    Returns:
        Columns `recording subject` and one for each loss, in the unit of its error, see `tune.LOSSES`.

    Raises:
        ValueError: if the estimator or the references cannot answer a loss.
    """
    import pandas as pd

    from jgait.tune import LOSSES, lacking, objective

    reasons = [reason for name in names if (reason := lacking(name, lessons.data.reference))]
    if reasons:
        raise ValueError("; ".join(reasons))
    objective(estimator, lessons.options, dict.fromkeys(names, 1.0))
    estimates, data = _estimates(estimator, p, lessons), lessons.data
    errors = [jax.jit(jax.vmap(LOSSES[name].error))(estimates, data) for name in names]
    rows: dict[str, PyTree] = {"recording": list(lessons.names), "subject": list(lessons.subjects)}
    return pd.DataFrame(rows | {name: np.asarray(error) for name, error in zip(names, errors, strict=True)})


def _estimates(estimator: Estimator[PyTree, PyTree], p: PyTree, lessons: "Lessons") -> PyTree:
    """The estimates of all lessons, stacked, by a program of its own, which losses over the same recordings share."""

    def subject_params(body: dict[str, PyTree], _: PyTree) -> PyTree:
        return jax.tree.map(jnp.asarray, estimator.with_body(p, body))

    data, n = lessons.data, len(lessons.names)
    return program(estimator.run, lessons.options, None)(
        jax.vmap(subject_params)(data.body, jnp.arange(n)), data.inputs
    )
