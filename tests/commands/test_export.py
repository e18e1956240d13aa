"""`jgait export`: files that run elsewhere, and recordings that cannot calibrate."""

import json

from made import command


def test_export_writes_the_programs_their_description_and_an_example(walk, tmp_path):
    out = tmp_path / "out"
    code, said = command.run("export", walk, "--estimator", "leg_ekf", "--thigh", "0.44", "--single", "--out", out)
    assert code == 0, said
    assert "operations a sample" in said
    parts = ("begin.bin", "step.bin", "begin.mlir", "step.mlir", "constants.npz", "example.py")
    assert {path.name for path in out.glob("legs*")} == {"legs.json", *(f"legs_{part}" for part in parts)}
    about = json.loads((out / "legs.json").read_text())
    assert about["sensors"] == ["thigh_right", "shank_right"]
    assert str(about["state_bytes"]) in said
    assert about["sample"]["gyr"] == ["float32", [2, 3]]


def test_export_says_what_has_no_form_sample_by_sample_and_what_cannot_calibrate(walk, tmp_path):
    for words, message in (
        (("--estimator", "waist"), "waist has no form sample by sample"),
        (("--estimator", "foot_ins"), "foot_ins has no sensors"),
        (("--person", tmp_path / "nobody.json"), "nobody.json"),
    ):
        code, said = command.run("export", walk, *words, "--out", tmp_path / "none")
        assert code == 2
        assert message in said
    assert not (tmp_path / "none").exists()
