"""Heel strikes and walked distance from one sensor at the waist: Tables I and II in simulation, and real walks.

Source: A. Köse, A. Cereatti, U. Della Croce, "Estimation of traversed distance in level walking using a single inertial
measurement unit attached to the waist", 2011. Real walks: `mobgap_lab` and `ipol_gait`, whichever are in the data
folder, with mobgap beside ours. Parameters are the defaults; what is learned is learned on other people.

    .venv/bin/python experiments/waist_ofdri.py [--quick] [--json FILE]
"""

import _waist_peer
import _waist_real as real
from _waist_contacts import contacts
from _waist_distance import distances
from _waist_parts import gradient, wavelets
from _waist_sim import simulated
from common import Row, main


def experiment(quick: bool) -> list[Row]:
    """All parts; what needs recordings or libraries that are not here says so and is left out."""
    rows = wavelets(quick) + gradient(quick)
    names = real.SETS[:1] if quick else real.SETS
    sets = {name: walks for name in names if (walks := real.walks(name, quick))}
    if sets:
        rows += contacts(sets, quick) + distances(sets, quick)
    if quick:
        print("left out of the quick form: ipol_gait, whose feet compile a program of their own, and mobgap")
    elif sets:
        rows += _waist_peer.compared(sets)
    return rows + simulated(quick)


if __name__ == "__main__":
    main("waist_ofdri", __doc__.splitlines()[0], experiment)
