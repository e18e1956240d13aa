"""Noise scales by likelihood, from data drawn from the model; which scales the data determine; innovations after it."""

import warnings
from typing import Any

import jax
import numpy as np
import optax

from experiments.common import consistency
from experiments.common.row import Row, show
from experiments.tuning import problems
from experiments.tuning.problems import FREE, START, TRUE, Drawn, Noise, filtered, nats
from jgait import tune
from jgait.tune import Fit


def cohort_fit(data: Drawn, steps: int) -> Fit[Noise]:
    """All four noise scales by likelihood, although no innovation tells of the position's: the rows name it so."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "not learned: position_noise", UserWarning)
        return tune.fit(nats, START, FREE, data, optax.lbfgs(), steps=steps)


def rows(quick: bool) -> list[Row]:
    """Noise scales by likelihood on legs drawn from the model; which are determined at all, in words."""
    people = 8 if quick else 32
    learn, other = (problems.drawn(jax.random.key(seed), people) for seed in (1, 2))
    fit = cohort_fit(learn, 15 if quick else 40)
    said = tune.identifiability(nats, fit.params, FREE, learn)
    show(
        f"{people} legs drawn from the model, likelihood",
        ["noise", "true", "start", "found", "standard error, logarithm", "determined"],
        [
            [name, getattr(TRUE, name), getattr(START, name), float(getattr(fit.params, name)), float(error),
             "no" if name in said.undetermined else "yes"]
            for name, error in zip(said.names, said.stderr_free, strict=True)
        ],
    )  # fmt: skip
    print("\n".join(f"  {sentence}" for sentence in said.sentences))
    known = [name for name in Noise._fields if name not in said.undetermined]
    errors = [abs(float(getattr(fit.params, name)) / getattr(TRUE, name) - 1.0) for name in known]
    split = "drawn from the leg model"
    named = float(set(said.undetermined) == {"position_noise", "bias_noise"})
    return [
        Row("recover_noise_rel_error_max", max(errors), "ratio", n=people, split=f"{split}: {', '.join(known)}").on(
            "noise scales by likelihood, from data drawn from the model: largest relative error",
            of="legs",
            simulated=True,
        ),
        Row("recover_noise_unidentifiable_named", named, "bool", n=people, split=f"{split}: σ_xy and σ_β, no others"),
        *consistent(other, START, fit.params, people),
    ]


def consistent(data: Drawn, before: Noise, after: Noise, people: int) -> list[Row]:
    """Innovations of people that the tuning never saw: NIS and whiteness, before and after."""
    rows, lines = [], []
    split = "other legs than those tuned on"

    @jax.jit
    def told(p: Noise) -> Any:
        return jax.vmap(lambda item: filtered(p, item, "nis", "count", "innovation", "innovation_stddev"))(data)

    for name, p in (("before", before), ("after", after)):
        found = told(p)
        nis = consistency.nis_consistency(np.ravel(found.nis), np.ravel(found.count))
        each = [consistency.nis_consistency(*both) for both in zip(found.nis, found.count, strict=True)]
        people_inside = float(np.mean([one.consistent for one in each]))
        white = [
            np.stack([np.asarray(v[i]) / np.asarray(s[i]) for v, s in zip(found.innovation, found.innovation_stddev,
                                                                        strict=True)], axis=1)
            for i in range(people)
        ]  # fmt: skip
        tests = [consistency.whiteness(values) for values in white]
        inside = float(np.mean([one.share_inside for one in tests]))
        passed = float(np.mean([one.consistent for one in tests]))
        lines.append([name, nis.mean, nis.low, nis.high, people_inside, inside, passed])
        rows += [
            Row(f"nis_{name}", nis.mean, "1", n=people, split=split),
            Row(f"nis_inside_{name}", float(nis.consistent), "bool", n=people, split=f"{split}: all as one"),
            Row(f"nis_people_inside_{name}", people_inside, "ratio", n=people, split=f"{split}: 95 % band of each"),
            Row(f"white_lags_inside_{name}", inside, "ratio", n=people, split=split),
            Row(f"white_people_{name}", passed, "ratio", n=people, split=f"{split}: Ljung–Box at 95 %"),
        ]
    show(
        f"innovations of {people} other legs",
        ["", "NIS", "95 % from", "to", "people inside their band", "autocorrelations inside", "people white"],
        lines,
    )
    return rows
