"""`jgait tune`: parameters from a cohort by gradient, judged on people from whom they were not learned."""

from pathlib import Path
from typing import Annotated, Any

import jax
import typer

from jgait import io
from jgait.commands import cohort as cohorts
from jgait.commands import console, machines, options, recordings, tune_report, tune_run
from jgait.commands import preset as presets
from jgait.commands.cohort_table import COPIED, REFERENCES, Source
from jgait.commands.console import refused, say_failures, stop
from jgait.commands.folder import results_folder
from jgait.commands.options import measures_of, pipeline_of, start_of, tunings
from jgait.notes import meant, of_recordings
from jgait.params import freed, priors
from jgait.params import names as parameters
from jgait.tune import Lessons, objective, parsed

SOFT = frozenset({"softness", "threshold_factor"})
"""Parameters of soft stances: who frees one of them gets soft stances, for the hard decision has no gradient."""


def tune(
    context: typer.Context,
    free: Annotated[
        str | None,
        typer.Option(help="What is learned, for example distance_scale,angle_noise; with --preset found by itself."),
    ] = None,
    table: cohorts.File = None,
    dataset: cohorts.Dataset = None,
    simulated: cohorts.Simulated = None,
    loss: Annotated[
        str | None,
        typer.Option(
            help="Losses with weights, for example position=1,stride_length=0.2; default: distance, with --preset what "
            "the references answer."
        ),
    ] = None,
    judge: Annotated[
        str | None, typer.Option(help="The loss whose error judges people; default: the first loss.")
    ] = None,
    steps: Annotated[int, typer.Option(min=1, help="Largest number; a fit stops earlier where the loss is flat.")] = 60,
    starts: Annotated[int, typer.Option(min=1, help="Number of starting points; the first is as given.")] = 1,
    folds: Annotated[int | None, typer.Option(min=2, help="Groups of people or days; default: each alone.")] = None,
    cross: Annotated[bool, typer.Option("--cross-validation/--no-cross-validation", help="Judge on others.")] = True,
    estimator: options.EstimatorName = "leg_ekf",
    noise: Annotated[
        str | None, typer.Option(help="Noise model of the zero velocity: constant, log_linear or network.")
    ] = None,
    paper: options.Paper = False,
    params: options.Params = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    seed: cohorts.Seed = 0,
    preset: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Choose what can be learned, judge it on others, and write it as a preset if it gains."
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for results; an interrupted run continues there.")] = Path(
        "jgait-tuning"
    ),
    dask: machines.Dask = None,
    part: machines.PartText = None,
    fresh: console.Fresh = False,
    json_file: console.Json = None,
) -> None:
    """Learn parameters from a cohort by gradient, and judge them on people from whom they were not learned.

    Of a single person, whole days are left out instead, where they are known (column day).

    Writes tuned.json (for `jgait evaluate --params` and `jgait estimate --params`), held_out.csv and figures. Exit
    code 0: all recordings were used; 1: some could not be used; 2: nothing could be learned.
    """
    loss = "distance" if loss is None and preset is None else loss
    names, weights, judged = _asked(free, loss, judge, preset, cross)
    pipeline = pipeline_of(estimator, paper, params, noise, soft=not SOFT.isdisjoint(names))
    start = start_of(pipeline, params, paper)
    try:
        learned = freed(pipeline.transforms, *names)
    except ValueError as error:
        known = [part for name in parameters(pipeline.transforms) for part in {name.partition(".")[0], name}]
        wrong = next(name for name in names if name not in known)
        stop(f"--free: {error}{meant(wrong, known)}")
    for name in names:
        if any(name == other or name.startswith(f"{other}.") for other in pipeline.unused):
            stop(f"--free: no number of {pipeline.name} depends on {name} with these options")
    source = cohorts.source(table, dataset, simulated, seed, gyr_unit, acc_unit, measures_of(pipeline), params)
    if every := [*weights, *filter(None, [judged])]:
        with refused():
            objective(pipeline, None, dict.fromkeys(every, 1.0))
    failures = list(source.failures)
    walks, ready = tune_run.prepared(source, pipeline, failures)
    weights = weights or {presets.loss_of(pipeline, walks.items): 1.0}
    judged = judged or next(iter(weights))
    try:
        made = tune_run.lessons_of(ready, walks, start, names, failures, list(dict.fromkeys([*weights, judged])))
    except ValueError as error:
        stop(str(error))
    finally:
        say_failures(failures)
    if used := [c for c in source.copies if {c.values["recording"], c.values["other"]} <= set(made.names)]:
        stop(f"{'; '.join(map(str, used))}. {COPIED.meaning}")
    groups = tune_run.groups_of(made)
    terms = objective(pipeline, made.options, weights)
    if preset is not None:
        logarithms = presets.terms_of(pipeline, start, made, weights)
        of_reference = objective(pipeline, made.options, logarithms)
        names = names or presets.learnable(pipeline, start, made, groups.labels, of_reference)
        terms = presets.with_likelihood(pipeline, made, logarithms)
        learned = freed(pipeline.transforms, *names)
        console.say(f"learned: {', '.join(names)}, from {', '.join(str(name) for name, _ in terms.terms)}")
        loss = ",".join(f"{name}={weight:.4g}" for name, weight in terms.terms)
    if cross and folds is not None and 1 < (count := len(set(groups.labels))) < folds:
        stop(f"--folds must be between 2 and the {count} {groups.many}; got {folds}")
    of = machines.part_of(part)
    if of is not None and not (cross and len(set(groups.labels)) > 1):
        stop("--part is of the cross-validation, whose folds are fitted apart; there is none")
    how = {
        "pipeline": "paper" if paper else "default", "free": names, "loss": loss, "steps": steps, "starts": starts,
        "seed": seed, "left_out": groups.many, **_data_of(source, made, params),
    }  # fmt: skip
    asked = how | {"estimator": pipeline.name, "judge": judged, "folds": folds, "cross_validation": cross}
    asked |= {"params": None if params is None else str(params), **source.marks}
    read = [table, params, *source.files]
    if of is None:
        planned = tune_report.PLANNED
        whole = results_folder(out, "tune", asked, planned=planned, inputs=read, json_file=json_file, fresh=fresh)
    else:
        whole = of.folder(out, "tune", context, asked, read, fresh)
    with whole as folder, machines.client_of(dask) as client:
        if of is None:
            tune_run.say_notes(ready, start, walks, made, weights)
        prior = priors(start) if preset is None else presets.priors_of(pipeline, start, names)
        settings = {"steps": steps, "starts": starts, "key": jax.random.key(seed), "priors": prior}
        fits = settings, folds, folder.run, of, client
        job = tune_run.Job(pipeline, start, learned, made, groups, terms, judged, *fits)
        results = tune_run.run(job, cross, weights)
        title = f"{pipeline.name}{', the paper’s pipeline,' if paper else ''} tuned on {source.title}"
        outcome = None if results is None else tune_report.report(title, job, results, how, folder, failures, json_file)
    if results is None or outcome is None:
        console.say(f"part {of} is done; with all parts there: jgait join {out}")
    elif preset is not None:
        presets.write(preset, pipeline, start, results.fit.params, outcome, groups.many, judged, dataset)
    if failures:
        console.say(f"{of_recordings(len(failures), len(failures) + len(made.names))} could not be used")
        raise typer.Exit(1)


def _asked(
    free: str | None, loss: str | None, judge: str | None, preset: str | None, cross: bool
) -> tuple[list[str], dict[str, float], str | None]:
    """What is learned, the losses with their weights, and the loss that judges; exits with code 2 if they are wrong."""
    if preset is not None:
        with refused("--preset: "):
            io.preset_file(preset)
        if not cross:
            stop("--preset needs the cross-validation")
    with refused("--loss: "):
        weights = {} if loss is None else parsed(loss)
    with refused("--judge: "):
        judged = None if judge is None else next(iter(parsed(judge)))
    names = [name.strip() for name in (free or "").split(",") if name.strip()]
    if not names and (preset is None or free is not None):
        stop("--free names nothing to learn")
    return names, weights, judged


def _data_of(source: Source, made: Lessons, params: Path | None) -> dict[str, Any]:
    """What was learned from, for the file of parameters."""
    return {
        "cohort": source.title, "recordings": len(made.names), "people": len(set(made.subjects)),
        "options": {name: getattr(made.options, name) for name in ("soft", "noise") if hasattr(made.options, name)},
        "subjects": sorted(set(made.subjects)), "data": source.versions(made.names, ("file", *REFERENCES)),
        "before": [{name: tuning[name] for name in ("cohort", "subjects", "data")}
                   for tuning in tunings(params) if "subjects" in tuning],
    }  # fmt: skip
