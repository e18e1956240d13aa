"""The filter benchmark runs, and the fast path is fast: some compilers made it hundreds of times slower."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.release

ROOT = Path(__file__).parents[2]


def test_the_fast_path_is_fast(tmp_path):
    result = tmp_path / "benchmark_filters.json"
    command = [sys.executable, "-m", "experiments", "benchmark_filters", "--quick", "--json", str(result)]
    # Speed is that of programs as users compile them, not as tests do.
    plain = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=500, check=False, env=plain, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    values = {row["metric"]: row["value"] for row in json.loads(result.read_text())["rows"]}
    # What is measured is 25 and 3 s; other jax versions gave 0.2 and 165 s.
    assert values["filter_ratio_textbook_b64"] > 5.0
    assert values["compile_seconds_gradient"] < 20.0
    assert values["filter_float32_error_fast"] < 2.0 * values["filter_float32_error_textbook"]
    assert values["grad_ratio_textbook_b64"] > 5.0
