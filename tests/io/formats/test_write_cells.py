"""Texts in tables that a spreadsheet would compute, and tables read back."""

import pandas as pd
import pytest

from jgait import RecordingError, io

TEXTS = ['=HYPERLINK("x")', "+1", "-2", "@SUM(A1)", "\t=1", "'=1", "''-1", "'quoted'", "anna", "Müller, Eva", ""]


@pytest.mark.parametrize("ending", ["csv", "json", "parquet"])
def test_texts_run_nothing_and_are_read_back(tmp_path, ending):
    table = pd.DataFrame({"subject": TEXTS[:-1], "=name": [f"{text}x" for text in TEXTS[:-1]],
                          "length_m": [-1.25 + k for k in range(len(TEXTS) - 1)]})  # fmt: skip
    path = io.write_table(table, tmp_path / f"strides.{ending}")
    if ending == "csv":
        raw = pd.read_csv(path, dtype=str)
        cells = [*raw.columns, *raw["subject"], *raw.iloc[:, 1]]
        assert not any(cell.startswith(("=", "+", "-", "@", "\t", "\r")) for cell in cells)
        assert raw["length_m"][0] == "-1.25"
    pd.testing.assert_frame_equal(io.read_table(path), table, check_dtype=False)


def test_what_is_no_table_is_refused(tmp_path):
    for name, content in (("a.csv", b""), ("b.json", b"[1"), ("c.parquet", b"PAR1")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(RecordingError, match=name):
            io.read_table(tmp_path / name)
