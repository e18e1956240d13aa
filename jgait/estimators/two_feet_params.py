"""Parameters and options of the joint estimator of both feet, with their units and ranges."""

import math
from typing import Any, NamedTuple

from jgait import filtering
from jgait.estimators.foot_ins import params as foot_params
from jgait.estimators.foot_ins.params import FootOptions, FootParams
from jgait.estimators.stride_width_ekf import params as stride_width_params
from jgait.estimators.stride_width_ekf.params import WidthOptions, WidthParams
from jgait.filtering.execution import Execution


class TwoFeetParams(NamedTuple):
    """Parameters of the joint estimator, in natural units.

    Attributes:
        foot: of each foot, see `FootParams`.
        range_offset: what the foot sensors are farther apart, across the walk, than the range says [m]; as of
            `WidthParams`, to be measured on the person.
        offset_noise: standard deviation of that measurement [m]; enters the stated errors only.
        passing_offset: how far the right foot is ahead of the left one when a range comes [m].
        passing_offset_noise: standard deviation of it [m]; enters the stated errors only.
        range_noise: standard deviation of the range as the distance across [m].
        passing_noise: standard deviation of how far the right foot is ahead when a range comes [m]; nobody measures it,
            so no likelihood can learn it.
        start_width: distance across at the start [m].
        start_across: its standard deviation [m].
        start_along: standard deviation of the distance along at the start [m], 0 expected.
        start_heading: standard deviation of the angle between both feet's first strides [rad], 0 expected.
    """

    foot: FootParams = FootParams()
    range_offset: Any = 0.08
    offset_noise: Any = 0.01
    passing_offset: Any = 0.0
    passing_offset_noise: Any = 0.03
    range_noise: Any = 0.01
    passing_noise: Any = 0.04
    start_width: Any = 0.15
    start_across: Any = 0.15
    start_along: Any = 0.5
    start_heading: Any = 0.2


TRANSFORMS = TwoFeetParams(
    foot=foot_params.TRANSFORMS,
    **{name: getattr(stride_width_params.TRANSFORMS, name) for name in TwoFeetParams._fields if name != "foot"},
)
"""The range of every parameter; fixed is what no recording can tell."""


class TwoFeetOptions(NamedTuple):
    """Which parts are on.

    Attributes:
        smooth: Rauch–Tung–Striebel smoothing (offline).
        level: as of `FootOptions`.
        detector: as of `FootOptions`.
        method: how the filter linearises, see `jgait.filtering`.
        execution: how the filter computes, see `jgait.filtering`.
        longest_range: ranges above it are of something else than the other leg [m].
        turn: a foot that turns more than this from stride to stride turns; ranges are then left out [rad].
        outlier: ranges farther than this from the median of their nine neighbours are left out [m].
        align_range: estimate how late the range's clock is, and take it off.
        widest_stddev: a width with a larger standard deviation is flagged [m].
    """

    smooth: bool = True
    level: bool | str = "auto"
    detector: str = "adaptive"
    method: Any = filtering.EKF()
    execution: Execution = "auto"
    longest_range: float = 0.5
    turn: float = math.radians(15.0)
    outlier: float = 0.1
    align_range: bool = True
    widest_stddev: float = 0.05


DEFAULT = TwoFeetOptions()
"""The best pipeline."""


def foot_options(options: TwoFeetOptions) -> FootOptions:
    """What concerns each foot."""
    return FootOptions(
        smooth=options.smooth, level=options.level, detector=options.detector, method=options.method,
        execution=options.execution,
    )  # fmt: skip


def width_options(options: TwoFeetOptions) -> WidthOptions:
    """What concerns the range."""
    return WidthOptions(
        longest_range=options.longest_range, turn=options.turn, outlier=options.outlier,
        align_range=options.align_range, widest_stddev=options.widest_stddev,
    )  # fmt: skip


def width_params(p: TwoFeetParams) -> WidthParams:
    """What the read-out of widths takes."""
    shared = {name: value for name, value in p._asdict().items() if name != "foot"}
    return WidthParams(**shared)


def with_body(p: TwoFeetParams, body: dict[str, Any]) -> TwoFeetParams:
    """The parameters with a person's own measures put in.

    Args:
        p: parameters.
        body: "pivot_height", "range_offset" and "passing_offset" [m], as far as known.

    Raises:
        ValueError: if it names anything else.
    """
    known = ("pivot_height", "range_offset", "passing_offset")
    unknown = [name for name in body if name not in known]
    if unknown:
        raise ValueError(f"two_feet takes {', '.join(known)} of a person; got {unknown[0]!r}")
    foot = foot_params.with_body(p.foot, {name: body[name] for name in body if name == "pivot_height"})
    return p._replace(foot=foot, **{name: body[name] for name in body if name != "pivot_height"})


__all__ = [
    "DEFAULT", "TRANSFORMS", "FootOptions", "TwoFeetOptions", "TwoFeetParams", "foot_options", "width_options",
    "width_params", "with_body",
]  # fmt: skip
