"""`jgait export`: the steps of the estimators online as programs that run without jgait."""

from pathlib import Path
from typing import Annotated

import jax
import typer

from jgait import estimators, io
from jgait.commands import cohort as cohorts
from jgait.commands import options, recordings
from jgait.commands.console import console, refused, stop, table_of, visible, wrote
from jgait.commands.folder import results_folder
from jgait.commands.pipeline import start_of
from jgait.estimators.online import CAUSAL, online
from jgait.types import reason_of


def export(
    file: Annotated[Path, typer.Argument(help="A recording that calibrates: the person stands, then walks.")],
    estimator: Annotated[
        list[str] | None, typer.Option(help=f"Of {', '.join(CAUSAL)}; once for each; default all with sensors.")
    ] = None,
    params: cohorts.Params = None,
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
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path("jgait-export"),
) -> None:
    """Write what jgait.online computes at each sample as a program that runs without jgait (StableHLO).

    For each source, such as feet: SOURCE_begin.bin and SOURCE_step.bin, which jax.export.deserialize reads, the same as
    text (.mlir), SOURCE_constants.npz with parameters and calibration, SOURCE.json, and SOURCE_example.py, which runs
    them with jax, numpy and flatbuffers. Exit code 0: success; 2: the recording cannot calibrate.
    """
    body = options.person_of(person, options.given(None, height, thigh, shank))
    placement, placements = recordings.places_of(place)
    tuned = {}
    with refused():
        if params is not None:
            name = io.made_of(params)[0]
            tuned = {name: start_of(estimators.get(name), params, False)}
    try:
        walk = recordings.recording_of(
            file, rate=rate, gyr_unit=gyr_unit, acc_unit=acc_unit, format=format, placement=placement,
            placements=placements,
        )  # fmt: skip
    except Exception as error:
        stop(f"{file}: {reason_of(error)}")
    with refused(f"{file}: "), jax.enable_x64(not single):
        steps = online(walk, body, estimator, tuned).export()
    with results_folder(out, "export", None, inputs=[file, params, person]) as folder:
        written = folder.publish([path for step in steps.values() for path in step.save(folder.stage)])
    table = table_of("source", "sensors", "state [bytes]", "operations a sample", left=2)
    for source, step in steps.items():
        table.add_row(source, visible(", ".join(step.device.placements)), str(step.state_bytes), f"{step.operations:_}")
    console.print(table)
    wrote(written)
