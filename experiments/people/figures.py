"""The share of figures of gait that lie within the recorded 5 to 95 %; see `simulator.against_real`.

A simulated person is not the one who was recorded. How many figures another person has within is shown by recorded
people whose strides are about as long and as quick as a set's.
"""

import numpy as np

from experiments.common.recordings import available
from experiments.common.row import Row
from experiments.simulator.against_real import compared, figures_of_people, usual_person
from experiments.simulator.real import Figures, Spread, real, spread_of, summary
from experiments.simulator.simulated import SETS, Set, comparable
from jgait import simulate

ALIKE = 0.12
"""[1] Largest sum of the relative differences of stride time and stride length between strides that are alike."""

Recorded = dict[Set, list[tuple[str, Figures]]]
"""Set → name and strides of each recording."""


def apart(own: dict[str, float], usual: dict[str, Spread]) -> float:
    """Sum of the relative differences of stride time and length."""
    given = ("stride_time", "stride_length")
    return sum(abs(np.log(own[name] / usual[name].median)) if name in own else np.inf for name in given)


def of_others(given: Set, recorded: Recorded) -> tuple[int, int]:
    """Figures of people with strides like a set's: how many lie within 5 to 95 % of the set's other people, of all."""
    inside = count = 0
    for home, recordings in recorded.items():
        for name, strides in recordings:
            rest = [one for one in recorded[given] if one[0] != name]
            own, same = summary(strides), home.name == given.name
            # The sets of one person are of different people; a person is not held against himself.
            if not rest or (same and len(recorded[given]) == 1) or apart(own, spread_of(rest)) > ALIKE:
                continue
            bands = comparable(spread_of(rest))
            held = [one.low <= own[key] <= one.high for key, one in bands.items() if key in own]
            inside, count = inside + sum(held), count + len(held)
    return inside, count


def rows(quick: bool) -> list[Row]:
    """Of the usual person at every set's stride, and of recorded people at like strides."""
    sets = [given for given in (SETS[:1] if quick else SETS) if available(given.name)]
    recorded = {given: real(given.name, given.condition) for given in sets}
    found: list[Row] = []
    weighed: list[tuple[float, int]] = []
    for given, recordings in recorded.items():
        usual = spread_of(recordings)
        who = usual_person(usual, simulate.RECORDED, soft_tissue=1.0)
        own = compared(given, usual, figures_of_people([who], given)[0])
        inside, count = of_others(given, recorded)
        ours = sum(row.value for row in own)
        print(f"{given.label}: within are {ours:.0f} of {len(own)} figures of the simulated person,", end=" ")
        print(f"{inside} of {count} of recorded people with like strides")
        found += own
        weighed += [(inside / count, len(own))] if count else []
    if not found:
        return []
    share = 100.0 * float(np.mean([row.value for row in found]))
    row = Row("figures_inside_pct", share, "%", None, len(found), "all sets, what is given not counted")
    about = "figures of gait within 5 to 95 % of recorded ones, all sets"
    made = [row.on(about, "simulated people", "figures")]
    if weighed:
        total = sum(figures for _, figures in weighed)
        share = 100.0 * sum(share * figures for share, figures in weighed) / total
        split = "recorded people whose strides are about as long and as quick, sets without such people not counted"
        row = Row("figures_inside_recorded_pct", share, "%", None, total, split)
        made.append(row.on(about, "other recorded people", "figures"))
    return made
