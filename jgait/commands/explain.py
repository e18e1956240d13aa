"""`jgait explain`: which assumption moves a number of a recording."""

from pathlib import Path
from typing import Annotated

import typer

from jgait import plot
from jgait.commands import options, recordings
from jgait.commands.console import Json, note, refused, say, show_table, write_json, wrote
from jgait.commands.folder import keep_inputs
from jgait.commands.simulate import sensor_of
from jgait.evaluate.study import estimator_of
from jgait.report import moves
from jgait.tune import explain as explained_by


def explain(
    file: Annotated[Path, typer.Argument(help="One recording, as of jgait estimate.")],
    measure: Annotated[
        str | None, typer.Option(help="Such as stride_length, walking_speed, distance, knee_flexion_range.")
    ] = None,
    estimator: options.OneEstimator = None,
    sensors: Annotated[str, typer.Option(help="Whose calibration errs: mpu6000, opal, idg300, freesense.")] = "mpu6000",
    params: options.Params = None,
    person: options.PersonFile = None,
    height: options.Height = None,
    thigh: options.Thigh = None,
    shank: options.Shank = None,
    option: options.Options = None,
    rate: recordings.Rate = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    format: recordings.Format = None,
    place: recordings.Place = None,
    trial: recordings.Trial = None,
    figure: Annotated[Path | None, typer.Option(help="Draw the bars into this file, PNG or SVG.")] = None,
    json_file: Json = None,
) -> None:
    """Say which assumption moves a number of a recording: parameters, and the calibration of each sensor.

    Each assumption is taken to be wrong by its stated standard deviation, one at a time, by the gradient of the number.
    The table ranks them, and states the deviation that is left if the leg is measured, the sensor is calibrated, or the
    person stands still once more. Without --estimator, the first of feet, ankles, shanks, waist and legs that the
    sensors allow is explained. Exit code 0: success; 2: the recording or the measure cannot be used.
    """
    keep_inputs([figure, json_file], [file, params])
    errors = sensor_of(sensors)
    given = options.given(option, height, thigh, shank)
    how = recordings.how(rate, gyr_unit, acc_unit, None, format, place, trial)
    walk = recordings.only(file, how)
    with refused(f"{file}: "):
        name = estimator or estimator_of(walk).name
    if estimator is None:  # it was chosen by the sensors: measures of the person that it does not need are none of its
        given = {option: value for option, value in given.items() if name in options.owners(option)}
    choice = options.chosen(name, False, params, given)
    known = options.person_in(person)
    p, lacking = choice.personal(known)
    for line in lacking:
        note(line)
    losses = choice.estimator.about.losses or ()
    measure = measure or ("stride_length" if "stride_length" in losses else "distance")
    body = {**known, **{m.name: choice.given[m.option] for m in choice.estimator.about.measures
                        if m.option in choice.given}}  # fmt: skip
    with refused(f"{file}: "):
        result = explained_by(choice.estimator, p, walk, measure, sensor=errors, person=body)
    whole = moves.table(result)
    shown = (0, 1, 2, 5)  # a terminal is narrow; --json and the report have all columns
    columns, rows = [whole.columns[k] for k in shown], [[row[k] for k in shown] for row in whole.rows]
    show_table(whole._replace(columns=columns, rows=rows), title=f"what moves the {result.column.words}, by {name}")
    say(result.sentence)
    if figure is not None:
        figure.parent.mkdir(parents=True, exist_ok=True)
        wrote([plot.save(plot.explanation(result, title=file.name), figure)])
    write_json(json_file, {
        "measure": result.measure, "value": result.value, "stddev": result.stddev, "estimator": name,
        "assumptions": [a._asdict() for a in result.assumptions],
    })  # fmt: skip
