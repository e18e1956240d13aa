"""Which estimator, with which parameters: what the options of several commands come to."""

from pathlib import Path
from typing import Any

from jgait.commands.console import note, stop
from jgait.estimators import Estimator


def pipeline_of(name: str, paper: bool) -> Estimator[Any, Any]:
    """The estimator that was asked for; leaves with 2 where there is none."""
    from jgait import estimators
    from jgait.estimators import leg_ekf

    if paper and name != "leg_ekf":
        stop(f"--paper is a pipeline of leg_ekf; got --estimator {name}")
    try:
        return estimators.get(name, *([leg_ekf.PAPER] if paper else []))
    except ValueError as error:
        stop(str(error))


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
