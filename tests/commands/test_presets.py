"""Presets: files of parameters that bring the options for which they were tuned."""

import json

import numpy as np
import pytest
from made.command import run

from jgait import io
from jgait.commands.pipeline import pipeline_of, start_of
from jgait.estimators import noise
from jgait.estimators.foot_ins import FootParams
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
        (("--params", "preset:nothing"), "there is no preset 'nothing'"),
        (("--params", file), "tuned with the option 'colour', which this estimator does not have"),
        (("--params", tmp_path / "none.json"), "none.json"),
    ):
        code, said = run("evaluate", "--simulated", 1, "--estimator", "foot_ins", *words, "--out", tmp_path / "out")
        assert code == 2 and expected in said, said
    code, said = run("tune", "--simulated", 2, "--free", "distance_scale", "--noise", "log_linear")
    assert code == 2 and "leg_ekf has no noise models" in said
    code, said = run("tune", "--simulated", 2, "--estimator", "foot_ins", "--free", "pivot_height,height_noise")
    assert code == 2 and "no number of foot_ins depends on height_noise with these options" in said


def test_a_noise_model_keeps_hard_stances_and_who_frees_their_softness_gets_soft_ones():
    tuned = pipeline_of("foot_ins", False, None, "log_linear")
    assert "noise.rate" in str(io.units(tuned.params)) and "softness" in tuned.unused
    assert "softness" not in pipeline_of("foot_ins", False, soft=True).unused
    assert pipeline_of("leg_ekf", False, soft=True).name == "leg_ekf"
