"""Strides counted and measured from one sensor at the ankle (Silva, Afonso and Rocha 2017), on real recordings."""

from _ankle_real import real
from common import Row, main


def experiment(quick: bool) -> list[Row]:
    """All parts; what needs recordings that are not here says so and is left out."""
    return real(quick)


if __name__ == "__main__":
    main("ankle_stride", __doc__ or "", experiment)
