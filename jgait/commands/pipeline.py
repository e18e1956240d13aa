"""Which estimator, with which parameters: what the options of several commands come to."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jgait.commands.console import note, stop
from jgait.estimators import Estimator

MEASURES = ("thigh_length", "shank_length", "pivot_height", "range_offset")
"""A person's own measures [m] that an estimator may take, by the names of its parameters."""

OF = {
    "--thigh": ("leg_ekf", "duty_cycled_gyro"),
    "--shank": ("leg_ekf", "duty_cycled_gyro"),
    "--scale": ("leg_ekf",),
    "--pivot": ("foot_ins", "stride_width_ekf"),
    "--level": ("foot_ins", "stride_width_ekf"),
    "--range-offset": ("stride_width_ekf",),
    "--lever": ("ankle_stride",),
    "--axes": ("ankle_stride",),
    "--height": ("waist_ofdri",),
    "--sensor-height": ("waist_ofdri",),
    "--duty": ("duty_cycled_gyro",),
    "--filler": ("duty_cycled_gyro",),
    "--warm-up": ("duty_cycled_gyro",),
    "--paper": ("leg_ekf", "stride_width_ekf", "waist_ofdri", "duty_cycled_gyro"),
}
"""Options that only some estimators know, and which."""


def refuse_others(estimator: str, given: Mapping[str, Any]) -> None:
    """Leave with 2 where an option was given (is not None or False) that the estimator has no use for."""
    for option, value in given.items():
        if value not in (None, False) and estimator not in OF[option]:
            stop(f"{option} is an option of {' and '.join(OF[option])}; got --estimator {estimator}")


def pipeline_of(name: str, paper: bool) -> Estimator[Any, Any]:
    """The estimator that was asked for; leaves with 2 where there is none."""
    from jgait import estimators
    from jgait.estimators import duty_cycled_gyro, leg_ekf, stride_width_ekf
    from jgait.estimators import waist as waist_ofdri

    modules = (leg_ekf, stride_width_ekf, waist_ofdri, duty_cycled_gyro)
    papers = {module.__name__.rpartition(".")[2]: module.PAPER for module in modules}
    if name in estimators.names():
        refuse_others(name, {"--paper": paper})
    try:
        return estimators.get(name, *([papers[name]] if paper and name in papers else []))
    except ValueError as error:
        stop(str(error))


def measures_of(estimator: Estimator[Any, Any]) -> tuple[str, ...]:
    """Which of a person's own measures an estimator takes."""
    return tuple(name for name in MEASURES if name in getattr(estimator.params, "_fields", ()))


def start_of(estimator: Estimator[Any, Any], file: Path | None, paper: bool) -> Any:
    """The estimator's own parameters, or those of a file; leaves with 2 where they cannot be."""
    from jgait import io
    from jgait.params import check_params

    if file is None:
        return estimator.params
    try:
        params, made = io.read_params(file, estimator.params, estimator=estimator.name)
        check_params(params, estimator.transforms)
    except (ValueError, OSError) as error:
        stop(f"--params: {error}")
    tuned_for = made.get("pipeline")
    if tuned_for not in (None, _name(paper)):
        note(f"{file} was tuned for the pipeline {tuned_for!r}; this one is {_name(paper)!r}")
    if made.get("cohort"):
        note(
            f"{file} was tuned on {made['cohort']}: errors on people of that cohort are not held out; "
            "those that jgait tune printed are"
        )
    return params


def _name(paper: bool) -> str:
    return "paper" if paper else "default"
