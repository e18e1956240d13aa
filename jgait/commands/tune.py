"""`jgait tune`: parameters from a cohort by gradient, judged on people from whom they were not learned."""

import contextlib
import dataclasses
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any

import jax
import typer
from jaxtyping import PyTree

from jgait import io
from jgait.commands import cohort as cohorts
from jgait.commands import console, machines, recordings, tune_report, tune_run
from jgait.commands import preset as presets
from jgait.commands.console import refused, say_failures, stop
from jgait.commands.folder import results_folder
from jgait.commands.lessons import lessons_of, prepared
from jgait.commands.pipeline import measures_of, pipeline_of, start_of, tunings
from jgait.commands.references import REFERENCES
from jgait.commands.rows import COPIED
from jgait.estimators import Estimator
from jgait.evaluate.scores import Scores, score
from jgait.notes import Note, of_recordings
from jgait.params import freed, priors
from jgait.report.cohort import of_notes
from jgait.tune import LOSSES, Lessons, objective, parsed
from jgait.types import Estimate, Walk

SOFT = frozenset({"softness", "threshold_factor"})
"""Parameters of soft stances: who frees one of them gets soft stances, for the hard decision has no gradient."""

COMPARED = {"distance": "distance_m", "stride_length": "stride_length_m", "calibration": "stride_length_m"}
"""Loss → the quantity that it compares with the reference."""


Free = Annotated[
    str | None,
    typer.Option(help="What is learned, for example distance_scale,angle_noise; with --preset found by itself."),
]
Loss = Annotated[
    str | None,
    typer.Option(
        help="Losses with weights, for example position=1,stride_length=0.2; default: distance, with --preset what the "
        "references answer."
    ),
]
Judge = Annotated[str | None, typer.Option(help="The loss whose error judges people; default: the first loss.")]
Steps = Annotated[int, typer.Option(min=1, help="Largest number; a fit stops earlier where the loss is flat.")]
Starts = Annotated[int, typer.Option(min=1, help="Number of starting points; the first is as given.")]
Folds = Annotated[int | None, typer.Option(min=2, help="Groups of people or days; default: each alone.")]
Cross = Annotated[bool, typer.Option("--cross-validation/--no-cross-validation", help="Judge on others.")]
Noise = Annotated[str | None, typer.Option(help="Noise model of the zero velocity: constant, log_linear or network.")]
Preset = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="Choose what can be learned, judge it on others, and write it as a preset if it gains."
    ),
]
Out = Annotated[Path, typer.Option(help="Folder for results; an interrupted run continues there.")]


def tune(
    context: typer.Context,
    free: Free = None,
    table: cohorts.File = None,
    dataset: cohorts.Dataset = None,
    simulated: cohorts.Simulated = None,
    loss: Loss = None,
    judge: Judge = None,
    steps: Steps = 60,
    starts: Starts = 1,
    folds: Folds = None,
    cross: Cross = True,
    estimator: cohorts.EstimatorName = "leg_ekf",
    noise: Noise = None,
    paper: cohorts.Paper = False,
    params: cohorts.Params = None,
    gyr_unit: recordings.GyrUnit = None,
    acc_unit: recordings.AccUnit = None,
    seed: cohorts.Seed = 0,
    preset: Preset = None,
    out: Out = Path("jgait-tuning"),
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
    if preset is not None:
        with refused("--preset: "):
            io.preset_file(preset)
        if not cross:
            stop("--preset needs the cross-validation")
    with refused("--loss: "):
        loss = "distance" if loss is None and preset is None else loss
        weights = {} if loss is None else parsed(loss)
    with refused("--judge: "):
        judged = None if judge is None else next(iter(parsed(judge)))
    names = [name.strip() for name in (free or "").split(",") if name.strip()]
    pipeline = pipeline_of(estimator, paper, params, noise, soft=not SOFT.isdisjoint(names))
    start = start_of(pipeline, params, paper)
    if not names and (preset is None or free is not None):
        stop("--free names nothing to learn")
    with refused("--free: "):
        learned = freed(pipeline.transforms, *names)
    for name in names:
        if any(name == other or name.startswith(f"{other}.") for other in pipeline.unused):
            stop(f"--free: no number of {pipeline.name} depends on {name} with these options")
    source = cohorts.source(table, dataset, simulated, seed, gyr_unit, acc_unit, measures_of(pipeline), params)
    with refused():
        if every := [*weights, *([judged] if judged else [])]:
            objective(pipeline, None, dict.fromkeys(every, 1.0))
    failures = list(source.failures)
    walks, ready = prepared(source, pipeline, failures)
    weights = weights or {presets.loss_of(pipeline, walks.items): 1.0}
    judged = judged or next(iter(weights))
    try:
        made = lessons_of(ready, walks, start, names, failures, list(dict.fromkeys([*weights, judged])))
    except ValueError as error:
        say_failures(failures)
        stop(str(error))
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
    count = len(set(groups.labels))
    if cross and folds is not None and 1 < count < folds:
        stop(f"--folds must be between 2 and the {count} {groups.many}; got {folds}")
    of = machines.part_of(part)
    if of is not None and not (cross and count > 1):
        stop("--part is of the cross-validation, whose folds are fitted apart; there is none")
    how: dict[str, Any] = {
        "pipeline": "paper" if paper else "default", "free": names,
        "loss": loss, "steps": steps, "starts": starts, "seed": seed, "cohort": source.title,
        "recordings": len(made.names), "people": len(set(made.subjects)), "left_out": groups.many,
        "options": {name: getattr(made.options, name) for name in ("soft", "noise") if hasattr(made.options, name)},
        "subjects": sorted(set(made.subjects)), "data": source.versions(made.names, ("file", *REFERENCES)),
        "before": [{name: tuning[name] for name in ("cohort", "subjects", "data")}
                   for tuning in tunings(params) if "subjects" in tuning],
    }  # fmt: skip
    title = f"{pipeline.name}{', the paper’s pipeline,' if paper else ''} tuned on {source.title}"
    asked = {
        **how, "estimator": pipeline.name, "judge": judged, "folds": folds, "cross_validation": cross,
        "params": None if params is None else str(params), **source.marks,
    }  # fmt: skip
    read = [table, params, *source.files]
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(
            of.folder(out, "tune", context, asked, read, fresh) if of is not None else results_folder(
                out, "tune", asked, planned=tune_report.PLANNED, inputs=read, json_file=json_file, fresh=fresh
            )
        )  # fmt: skip
        client = stack.enter_context(machines.client_of(dask))
        if of is None:
            _say_notes(ready, start, walks, made, weights)
        prior = priors(start) if preset is None else presets.priors_of(pipeline, start, names)
        settings = {"steps": steps, "starts": starts, "key": jax.random.key(seed), "priors": prior}
        of_each = dataclasses.replace(terms, terms=((LOSSES[judged].error, 1.0),))
        job = tune_run.Job(
            pipeline, start, learned, made, groups, terms, of_each, LOSSES[judged].unit, LOSSES[judged].words, settings,
            folds, folder.run, of, client,
        )  # fmt: skip
        results = tune_run.run(job, cross, weights)
        outcome = None if results is None else tune_report.report(title, job, results, how, folder, failures, json_file)
    if results is None or outcome is None:
        console.say(f"part {of} is done; with all parts there: jgait join {out}")
    elif preset is not None:
        presets.write(preset, pipeline, start, results.fit.params, outcome, groups.many, judged, dataset)
    if failures:
        console.say(f"{of_recordings(len(failures), len(failures) + len(made.names))} could not be used")
        raise typer.Exit(1)


def _say_notes(
    ready: Estimator[PyTree, PyTree], start: PyTree, walks: cohorts.Source, made: Lessons, losses: Collection[str]
) -> None:
    """Print what is doubtful about the recordings learned from and their references, as `jgait evaluate` does.

    Exits with code 2 if the references of all contradict the estimates, as in another unit, in what the losses compare.
    """
    compared = {quantity for loss, quantity in COMPARED.items() if loss in losses}
    off: dict[str, Note] = {}

    def judged(estimate: Estimate, walk: Walk) -> Scores:
        result = score(estimate, walk)
        off.update((walk.recording.name, line) for quantity, line in result.contradicts[::-1] if quantity in compared)
        return result

    rows = cohorts.evaluated(ready, start, walks, score=judged).recordings
    rows = rows[rows["recording"].isin(made.names)]
    if len(rows) > 1 and off.keys() >= set(rows["recording"]):
        name = rows["recording"].iloc[0]
        first = off[name]
        stop(
            f"the references of all {len(rows)} recordings contradict the estimates, such as {name}: {first}. "
            f"{first.meaning}"
        )
    console.say_flags(of_notes(rows), "jgait evaluate of the same recordings")
