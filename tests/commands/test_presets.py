"""Presets: files of parameters that bring the options for which they were tuned."""

import json
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
import typer
from made import cohort as made_cohort
from made.command import run

from jgait import evaluate, io, params, tune
from jgait.commands import preset
from jgait.commands.options import pipeline_of, start_of
from jgait.commands.tune_report import TuningOutcome
from jgait.estimators import noise
from jgait.estimators.foot_ins import FootParams
from jgait.evaluate import PairedDifference
from jgait.io import params as files
from jgait.types import RecordingError


def test_a_preset_is_listed_with_its_error_and_brings_its_parameters(tmp_path, monkeypatch):
    held = {"error": "3-D error", "unit": "m", "n": 28, "before": 0.21, "after": 0.12}
    made = {"loss": "position=1", "cohort": "mine", "held_out": held, "options": {"noise": "log_linear"}}
    start = FootParams(noise=noise.model_of("log_linear"), rate_noise=0.07)
    io.write_params(tmp_path / "mine.json", start, estimator="foot_ins", made=made)
    code, said = run("presets")
    assert code == 0 and "none come with this version" in said
    monkeypatch.setattr(files, "PRESETS", tmp_path)
    code, said = run("presets")
    assert code == 0 and all(word in said for word in ("mine", "foot_ins", "0.21", "0.12"))
    pipeline = pipeline_of("foot_ins", False, "preset:mine")
    assert start_of(pipeline, "preset:mine", False) == pipeline.params._replace(rate_noise=0.07)


def test_a_preset_of_ones_own_has_versions_and_a_name_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    held = {"error": "3-D error", "unit": "m", "n": 28, "before": 0.21, "after": 0.12}
    for rate in (0.06, 0.07):
        file = io.write_preset(
            "my_lab", FootParams(rate_noise=rate), estimator="foot_ins",
            made={"loss": "position", "cohort": "mine", "held_out": held},
        )  # fmt: skip
    assert start_of(pipeline_of("foot_ins", False), "preset:my_lab", False).rate_noise == 0.07
    assert io.made_of("preset:my_lab")[1]["version"] == 2
    assert io.read_params(file.with_suffix(".v1"), FootParams(), estimator="foot_ins")[0].rate_noise == 0.06
    assert "my_lab" in run("presets")[1]


class Toy(NamedTuple):
    level: float = 1.0
    weak: float = 1.0
    torn: float = 1.0
    kept: float = 1.0


TOY = SimpleNamespace(
    name="toy", params=Toy(), transforms=Toy(*[params.real] * 4), unused=("kept",),
    about=SimpleNamespace(measures=(), losses=None),
)  # fmt: skip


def squares(p, item):
    level, torn = item
    return (level - p.level - 1e-3 * p.weak) ** 2 + torn * p.torn + p.kept


def test_what_people_agree_on_and_what_moves_the_loss_is_learned():
    rng = np.random.default_rng(0)
    items = rng.normal(5.0, 1.0, 12), np.tile([1.0, -1.0], 6)
    people = [f"p{i}" for i in range(12)]
    made = SimpleNamespace(data=items)
    assert preset.learnable(TOY, Toy(), made, people, squares) == ["level"]
    assert [(n.name, n.deviation) for n in preset.numbers(TOY, Toy())] == [(n, 0.1) for n in ("level", "weak", "torn")]
    for data, groups in (((items[0] - 4.0, items[1]), people), (items, ["a", "b"] * 6)):
        with pytest.raises(typer.Exit):
            preset.learnable(TOY, Toy(), SimpleNamespace(data=data), groups, squares)


def test_a_scale_that_is_wrong_for_everybody_is_learned_from_walks_with_one_bad_reference():
    walks = [made_cohort.walk(number) for number in range(1, 9) if number % 7]
    bad = walks[0].reference._replace(distance=3.0 * walks[0].reference.distance)
    walks = [walks[0]._replace(reference=bad), *walks[1:]]
    made = tune.lessons(made_cohort.FAKE, walks, body=lambda _: {"offset": 0.25})
    start = made_cohort.Params()
    logarithms = preset.terms_of(made_cohort.FAKE, start, made, {"distance": 1.0})
    terms = tune.objective(made_cohort.FAKE, made.options, logarithms)
    assert preset.learnable(made_cohort.FAKE, start, made, made.names, terms) == ["scale"]
    prior = preset.priors_of(made_cohort.FAKE, start, ["scale"])
    free = params.freed(made_cohort.FAKE.transforms, "scale")
    fit = tune.fit(preset.with_likelihood(made_cohort.FAKE, made, logarithms), start, free, made.data, priors=prior)
    errors = evaluate.judged(made_cohort.FAKE, fit.params, made, ["distance"])["distance"]
    assert np.median(errors) < 0.5 * np.median(evaluate.judged(made_cohort.FAKE, start, made, ["distance"])["distance"])


def test_a_preset_is_refused_that_does_not_gain():
    held = {"error": "|error|", "unit": "cm", "before": 4.0, "after": 3.0}
    gain, none = PairedDifference(-1.0, -1.5, -0.5, 9, 9, 0), PairedDifference(-0.1, -0.5, 0.2, 9, 5, 4)
    row = preset.Elsewhere("walking5m", "|error|", "cm", 8, 4.0, 3.9)
    for change, others, expected in (
        (None, [], "a verdict needs 6 people"), (gain._replace(n=5), [], "there are 5"),
        (none, [], "it does not gain on people left out"), (gain, [row], ""),
        (gain, [row, row._replace(name="foot", after=4.2)], "it is worse on other recordings, foot:"),
    ):  # fmt: skip
        reason = preset.refusal(TuningOutcome({"held_out": held}, {}, change), "people", others)
        assert expected in reason and bool(reason) == bool(expected)


def written(folder, model, **made):
    estimator = FootParams(noise=noise.model_of(model))
    p = estimator._replace(softness=0.3, noise=estimator.noise._replace(last=np.arange(8.0)))
    return p, io.write_params(folder / "p.json", p, estimator="foot_ins", made=made)


def test_a_file_brings_its_options_and_weights_of_any_shape(tmp_path):
    p, file = written(tmp_path, "network", options={"soft": True, "noise": "network"})
    pipeline = pipeline_of("foot_ins", False, file)
    made = start_of(pipeline, file, False)
    assert made.softness == 0.3
    np.testing.assert_array_equal(made.noise.last, p.noise.last)
    np.testing.assert_array_equal(made.noise.first, p.noise.first)
    whole = json.loads(file.read_text())
    whole["parameters"]["noise.last"]["value"] = [1.0, 2.0]
    file.write_text(json.dumps(whole))
    with pytest.raises(RecordingError, match=r"noise\.last of shape \(2,\); \(8,\) is wanted"):
        io.read_params(file, pipeline.params, estimator="foot_ins")


def test_files_that_do_not_fit(tmp_path):
    _, file = written(tmp_path, "network", options={"soft": True, "colour": "red"})
    for words, expected in (
        (("--params", file), "tuned with the option 'colour', which this estimator does not have"),
        (("--params", tmp_path / "none.json"), "none.json"),
    ):
        code, said = run("evaluate", "--simulated", 1, "--estimator", "foot_ins", *words, "--out", tmp_path / "out")
        assert code == 2 and expected in said, said


def test_a_noise_model_keeps_hard_stances_and_who_frees_their_softness_gets_soft_ones():
    tuned = pipeline_of("foot_ins", False, None, "log_linear")
    assert "noise.rate" in str(io.units(tuned.params)) and "softness" in tuned.unused
    assert "softness" not in pipeline_of("foot_ins", False, soft=True).unused
    assert pipeline_of("leg_ekf", False, soft=True).name == "leg_ekf"
