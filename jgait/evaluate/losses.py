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
    data = lessons.data

    def subject_params(body: dict[str, PyTree], _: PyTree) -> PyTree:
        return jax.tree.map(jnp.asarray, estimator.with_body(p, body))

    each = jax.vmap(subject_params)(data.body, jnp.arange(len(lessons.names)))
    estimates = program(estimator.run, lessons.options, None)(each, data.inputs)  # which losses of one cohort share
    rows: dict[str, PyTree] = {"recording": list(lessons.names), "subject": list(lessons.subjects)}
    for name in names:
        rows[name] = np.asarray(jax.jit(jax.vmap(LOSSES[name].error))(estimates, data))
    return pd.DataFrame(rows)
