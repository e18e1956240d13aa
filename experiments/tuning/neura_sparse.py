"""Tuned on one part of `neura_sparse`, judged on another: the rows of `leg_ekf`'s held-out walk."""

from experiments.bennett2013.neura_sparse import held_out, person
from experiments.common.recordings import available, walks
from experiments.common.row import Row


def rows(quick: bool) -> list[Row]:
    """The held-out walk; nothing in the quick form."""
    if quick or not available("neura_sparse"):
        return []
    walk = walks("neura_sparse")[0]
    return [row._replace(metric=f"neura_sparse_{row.metric}", line="") for row in held_out(walk, person(walk))]
