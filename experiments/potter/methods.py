"""The ways in which stride width is estimated here."""

from collections.abc import Callable

from jgait import filtering
from jgait.estimators import stride_width_ekf, two_feet
from jgait.estimators.stride_width_ekf import PAPER, Particles, WidthOptions, WidthParams
from jgait.types import Estimate, Recording

Method = Callable[[Recording, float, tuple[float, float] | None], Estimate]
"""(recording, offset of the range [m], first headings) → estimate."""


def by(options: WidthOptions) -> Method:
    """The 6-state filter with some options, on the feet's own trajectories."""

    def run(recording: Recording, offset: float, headings: tuple[float, float] | None) -> Estimate:
        p = WidthParams(range_offset=offset, offset_noise=1e-3)
        return stride_width_ekf.estimate(p, recording, options, start_heading=headings)

    return run


def joint(recording: Recording, offset: float, headings: tuple[float, float] | None) -> Estimate:
    """Both feet in one filter on their raw signals."""
    p = two_feet.TwoFeetParams(range_offset=offset, offset_noise=1e-3)
    return two_feet.estimate(p, recording, start_heading=headings)


DEFAULT = WidthOptions()
METHODS: dict[str, Method] = {
    "ekf": by(PAPER),
    "rts": by(DEFAULT),
    "unscented_rts": by(DEFAULT._replace(method=filtering.UKF())),
    "particles": by(DEFAULT._replace(method=Particles(), smooth=False, check_swap=False)),
    "literal": by(PAPER._replace(literal=True)),
    "joint": joint,
}
TITLES = {
    "ekf": "EKF, as the paper's", "rts": "iterated EKF + RTS, the default", "unscented_rts": "unscented + RTS",
    "particles": "particles", "literal": "EKF with the misprints", "joint": "one filter on both feet's signals, RTS",
    "no_range": "without the range",
}  # fmt: skip
