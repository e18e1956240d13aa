"""A gyroscope that sleeps part of the time (Udaya Shankar, Raveendranathan, Gans and Jafari 2010).

Table 2 and Figure 7: what the schedules save, and what every filler errs on `tripod` and `walking5m`; and what is
saved over them by waking the gyroscope when the filler doubts itself.
"""

from _duty_table import energy, fillings
from _duty_triggered import triggered
from common import Row, main


def experiment(quick: bool) -> list[Row]:
    """Energy column, error columns and policy; what needs recordings that are not here is left out."""
    return energy() + fillings(quick) + triggered(quick)


if __name__ == "__main__":
    main("duty_cycled_gyro", "Energy saved by a gyroscope that sleeps, and the error that it costs.", experiment)
