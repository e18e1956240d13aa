"""The share of figures of gait that lie within the recorded 5 to 95 %; see `simulator.against_real`."""

import numpy as np

from experiments.common.row import Row
from experiments.simulator.against_real import compared, figures_of_people, known_spread, usual_person
from experiments.simulator.simulated import SETS
from jgait import simulate


def rows(quick: bool) -> list[Row]:
    """Of the usual person at every set's stride."""
    found: list[Row] = []
    for given in SETS[:1] if quick else SETS:
        real = known_spread(given)
        if real is not None:
            found += compared(
                given, real, figures_of_people([usual_person(real, simulate.RECORDED, soft_tissue=1.0)], given)[0]
            )
    if not found:
        return []
    share = 100.0 * float(np.mean([row.value for row in found]))
    row = Row("figures_inside_pct", share, "%", None, len(found), "all sets, what is given not counted")
    return [row.on("figures of simulated gait within 5 to 95 % of recorded ones, all sets", of="figures")]
