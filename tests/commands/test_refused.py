"""What cannot be used or would be overwritten is refused in words, and nothing is written."""

import pytest
from made.command import run

WALK = "time,ankle_right_gyr_x\n0,1\n"

FILES = {
    "walk.csv": WALK, "a/walk.csv": "a\nb\n", "report.html": "a\nb\n", "empty.csv": "", "bare.csv": "file\n",
    "files.csv": "files\na.csv\n", "none.csv": "file\nno.csv\nnot.csv\n", "recordings.csv": "file\na/walk.csv\n",
    "high.json": '{"height": 175}', "text.json": '{"height": "1.75"}',
}  # fmt: skip

COMMANDS = {
    # how the user's options go together
    "estimate walk.csv --paper": "--paper is of one estimator; give --estimator as well",
    "estimate walk.csv --option duty=0.5": "--option duty is an option of duty_cycled_gyro; give --estimator as well",
    "estimate walk.csv --table-format xlsx": "--table-format is csv, parquet, json; got 'xlsx'",
    "estimate walk.csv --person high.json": "height must be between 0.8 and 2.4 m; got 175 (in cm? then 1.75)",
    "estimate walk.csv --person text.json": "height is 0.8 to 2.4 m, one number or [right, left]; got '1.75'",
    "estimate walk.csv --height nan": "height must be between 0.8 and 2.4 m; got nan",
    "estimate walk.csv --height 1,75": "'1,75' is no number; write a decimal point, 1.75",
    "estimate walk.csv --estimator leg_ekf --option scale=0": "--option scale must be at least 0.1; got 0",
    "estimate walk.csv --option scle=1": "one of the names duty, filler, height, level,",
    "estimate walk.csv --estimator foot_ins --thigh 0.4": "--thigh is an option of leg_ekf and duty_cycled_gyro; got",
    "estimate walk.csv --estimator foot_ins --option level=perhaps": "--option level is auto, yes, no; got 'perhaps'",
    "estimate walk.csv --place knee": "there is no placement 'knee'",
    "estimate walk.csv --place a=shank_right --place thigh_right": "got both",
    "estimate walk.csv --place shank_right --place thigh_right": "there can be one placement",
    "estimate walk.csv --part 4/3": "--part is K/N with a number K from 1 to N, such as 3/20; got '4/3'",
    "estimate walk.csv --part a/b": "--part is K/N with a number K from 1 to N, such as 3/20; got 'a/b'",
    "evaluate": "give one of: a table COHORT.csv, --dataset NAME, --simulated N; got none",
    "evaluate nowhere.csv": "there is no such file: nowhere.csv",
    "evaluate --dataset mine": "there is no data set 'mine'",
    "evaluate --simulated 1 --estimator mine": "estimator must be one of leg_ekf",
    "evaluate --simulated 1 --params nowhere.json": "--params: ",
    "evaluate --simulated 1 --estimator foot_ins --params preset:nothing": "there is no preset 'nothing'",
    "tune --simulated 2 --preset a/b": "letters, digits",
    "tune --simulated 2 --free distance_scale --noise log_linear": "leg_ekf has no noise models",
    "tune --simulated 2 --estimator foot_ins --free pivot_height,height_noise": "depends on height_noise with these",
    "report walk.csv --out page.pdf": "ends with .html; got 'page.pdf'",
    "report walk.csv --option lever=0.1 --paper": "--option lever is an option of ankle_stride; got",
    "report --simulated 2 --person p.json": "--person is of one recording",
    "report walk.csv --recording a": "--recording names a recording of a --dataset",
    "simulate --route zigzag:3": "--route is straight:LENGTH",
    "simulate --route straight:0": "from 1 to 1000 m",
    "simulate --gait sneaking": "--gait must be one of slow, fast",
    "simulate --rate 2": "--rate must be between 10 and 1000 Hz",
    "simulate --placements knee": "there is no 'knee'",
    "plan --places nose": "there is no 'nose'",
    "plan --rates fast": "--rates is a list of positive numbers",
    "explain walk.csv --sensors abacus": "--sensors must be one of",
    "plan walk.csv --trial a": "walk.csv is no Mobilise-D file, so there is no trial 'a'",
    "export walk.csv --trial a": "walk.csv is no Mobilise-D file, so there is no trial 'a'",
    # what a file holds
    "estimate empty.csv": "empty.csv: it is empty",
    "estimate a": "a: it is a folder, and none of a format",
    "evaluate files.csv": "did you mean 'files'?",
    "evaluate bare.csv": "must have a header and a row for each recording",
    "evaluate none.csv": "none of the 2 recordings of none.csv could be used",
    "report nowhere.csv": "nowhere.csv: there is no such file",
    "report a": "a: it is a folder, and none of a format",
    "report .": "is no folder that jgait evaluate wrote: ",
    # what would be overwritten
    "evaluate recordings.csv --out .": "recordings.csv is read by this command",
    "evaluate recordings.csv --json jgait-evaluation/quantities.csv": "is one of the files that this command writes",
    "estimate a/walk.csv --json a/walk.csv": "walk.csv is read by this command",
    "estimate a/walk.csv a/walk.csv": "a/walk.csv is given twice; give each recording once",
    "report report.html --out report.html": "report.html is read by this command",
    "report a/walk.csv --out p.html --json p.html": "--json and --out are the same file",
}
"""Command → a part of what it says."""


@pytest.mark.parametrize("words", COMMANDS)
def test_a_command_that_cannot_be_is_refused_in_words_and_writes_nothing(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    code, said = run(*words.split())
    assert code == 2 and COMMANDS[words] in said, said
    left = {path.relative_to(tmp_path).as_posix(): path.read_text() for path in tmp_path.rglob("*") if path.is_file()}
    assert left == FILES
