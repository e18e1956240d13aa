"""A gyroscope that sleeps part of the time (Udaya Shankar, Raveendranathan, Gans and Jafari 2010).

Table 2 and Figure 7: what the schedules save, and what every filler errs on `tripod` and `walking5m`.
"""

from _duty_table import energy, fillings
from common import Row, main


def experiment(quick: bool) -> list[Row]:
    """The energy column, and the error columns; what needs recordings that are not here says so and is left out."""
    return energy() + fillings(quick)


if __name__ == "__main__":
    main("duty_cycled_gyro", "Energy saved by a gyroscope that sleeps, and the error that it costs.", experiment)
