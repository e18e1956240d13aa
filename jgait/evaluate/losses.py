"""The losses of tuning as errors of recordings: one table for any estimator, any losses and any parameters."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax
import numpy as np
from jaxtyping import PyTree

from jgait.estimators.interface import Estimator

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

    def one(lesson: PyTree) -> list[PyTree]:
        estimate = estimator.run(estimator.own(p, lesson.own), lesson.inputs, lessons.options)
        return [LOSSES[name].error(estimate, lesson) for name in names]

    errors = jax.jit(jax.vmap(one))(lessons.data)
    rows: dict[str, PyTree] = {"recording": list(lessons.names), "subject": list(lessons.subjects)}
    return pd.DataFrame(rows | {name: np.asarray(error) for name, error in zip(names, errors, strict=True)})
