"""`jgait export`: the steps of the estimators online as programs that run without jgait."""

from pathlib import Path
from typing import Annotated

import jax
import typer

from jgait import estimators, io
from jgait.commands import options, recordings
from jgait.commands.console import refused, show, wrote
from jgait.commands.folder import results_folder
from jgait.estimators.online import CAUSAL, online


def export(
    file: Annotated[Path, typer.Argument(help="A recording that calibrates: the person stands, then walks.")],
    estimator: Annotated[
        list[str] | None, typer.Option(help=f"Of {', '.join(CAUSAL)}; once for each; default all with sensors.")
    ] = None,
    params: options.Params = None,
    person: options.PersonFile = None,
    height: options.Height = None,
    thigh: options.Thigh = None,
    shank: options.Shank = None,
    single: Annotated[bool, typer.Option("--single", help="Single precision, which small processors have.")] = False,
    rate: recordings.Rate = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    format: recordings.Format = None,
    place: recordings.Place = None,
    trial: recordings.Trial = None,
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path("jgait-export"),
) -> None:
    """Write what jgait.online computes at each sample as a program that runs without jgait (StableHLO).

    For each source, such as feet: SOURCE_begin.bin and SOURCE_step.bin, which jax.export.deserialize reads, the same as
    text (.mlir), SOURCE_constants.npz with parameters and calibration, SOURCE.json, and SOURCE_example.py, which runs
    them with jax, numpy and flatbuffers. Exit code 0: success; 2: the recording cannot calibrate.
    """
    body = options.person_of(person, options.given(None, height, thigh, shank))
    how = recordings.how(rate, gyr_unit, acc_unit, None, format, place, trial)
    tuned = {}
    with refused():
        if params is not None:
            name = io.made_of(params)[0]
            tuned = {name: options.start_of(estimators.get(name), params, False)}
    walk = recordings.only(file, how)
    with refused(f"{file}: "), jax.enable_x64(not single):
        steps = online(walk, body, estimator, tuned).export()
    with results_folder(out, "export", None, inputs=[file, params, person]) as folder:
        written = folder.publish([path for step in steps.values() for path in step.save(folder.stage)])
    rows = [(source, ", ".join(step.device.placements), step.state_bytes, f"{step.operations:_}")
            for source, step in steps.items()]  # fmt: skip
    show("source", "sensors", "state [bytes]", "operations a sample", rows=rows, left=2)
    wrote(written)
