"""Strides counted and measured from one sensor at the ankle (Silva, Afonso and Rocha 2017).

Tables I and II in simulation, and on real recordings: `tripod`, `neura_sparse`, `walking5m`; the same sample by sample,
and what a sample costs.
"""

from _ankle_online import online
from _ankle_real import real
from _ankle_sim import simulated
from common import Row, main


def experiment(quick: bool) -> list[Row]:
    """All parts; what needs recordings that are not here says so and is left out."""
    return real(quick) + online(quick) + simulated(quick)


if __name__ == "__main__":
    main("ankle_stride", "Strides from one sensor at the ankle: simulated routes and real recordings.", experiment)
