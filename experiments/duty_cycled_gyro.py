"""A gyroscope that sleeps part of the time (Udaya Shankar, Raveendranathan, Gans and Jafari 2010).

Table 2 and Figure 7: what the schedules save, and what every filler errs on `tripod`, `walking5m`, `neura_sparse` and
in simulation; what schedules found by gradient, and waking the gyroscope when the filler doubts itself, save over them;
and what is left of the errors in the angles. --figures FOLDER draws.
"""

import argparse
import sys
from pathlib import Path

from _duty_figures import figures
from _duty_joint import behind, joint
from _duty_table import energy, fillings
from _duty_tradeoff import tradeoff
from _duty_triggered import triggered
from common import Row, main


def experiment(quick: bool, folder: Path | None = None) -> list[Row]:
    """All parts; what needs recordings that are not here is left out."""
    rows = energy() + fillings(quick)
    front, fronts = tradeoff(quick)
    rows += front + triggered(quick)
    if folder is not None:
        figures(rows, fronts, folder)
    return rows + behind(quick) + joint(quick)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--figures", type=Path)
    own, sys.argv[1:] = parser.parse_known_args()
    about = "Energy saved by a gyroscope that sleeps, and the error that it costs. --figures FOLDER: where pictures go"
    main("duty_cycled_gyro", about, lambda quick: experiment(quick, own.figures))
