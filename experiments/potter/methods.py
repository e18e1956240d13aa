"""The estimators of stride width that this experiment compares."""

from collections.abc import Callable

from experiments.potter import literal
from jgait import filtering
from jgait.estimators import stride_width_ekf
from jgait.estimators.stride_width_ekf import PAPER, WidthOptions, WidthParams
from jgait.types import Estimate, Recording

Method = Callable[[Recording, float, tuple[float, float] | None], Estimate]
"""(recording, offset of the range [m], first headings) → estimate."""


def by(options: WidthOptions, run: Callable[..., Estimate] = stride_width_ekf.run) -> Method:
    """The 6-state filter with some options, on the feet's own trajectories."""

    def estimate(recording: Recording, offset: float, headings: tuple[float, float] | None) -> Estimate:
        p = WidthParams(range_offset=offset, offset_noise=1e-3)
        return stride_width_ekf.estimator(options, start_heading=headings)._replace(run=run).estimate(p, recording)

    return estimate


DEFAULT = WidthOptions()
METHODS: dict[str, Method] = {
    "ekf": by(PAPER),
    "rts": by(DEFAULT),
    "unscented_rts": by(DEFAULT._replace(method=filtering.UKF())),
    "literal": by(PAPER, literal.run),
}
TITLES = {
    "ekf": "EKF, as the paper's", "rts": "iterated EKF + RTS, the default", "unscented_rts": "unscented + RTS",
    "literal": "EKF with the misprints", "no_range": "without the range",
}  # fmt: skip
