"""Every block of Python in the README, the guide and the page of formats runs as written, in a folder of its own."""

import re
import subprocess
import sys
from pathlib import Path

import jax
import pytest
from made.process import environment

from jgait import io, simulate

ROOT = Path(__file__).parents[1]
GUIDE = sorted(str(page.relative_to(ROOT)) for page in (ROOT / "docs" / "guide").glob("*.md"))
PAGES = ["README.md", "docs/formats.md", *GUIDE]


def blocks(page):
    return re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def run(code, folder):
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=900, check=False, cwd=folder,
        env=environment(),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.release
@pytest.mark.parametrize("page", PAGES)
def test_the_python_of_a_page_runs_as_written(page, tmp_path):
    code = blocks(page)
    assert code
    if page == "README.md":
        person = simulate.Person(gait=simulate.gait(speed=1.2, stature=1.75))
        walked, _ = simulate.recording(jax.random.key(0), person, simulate.straight(8.0), placements=simulate.FOUR)
        io.write_csv(walked, tmp_path / "walk.csv")
    if page == "docs/guide/tuning.md":  # goes on with the filter of the page before
        code = blocks("docs/guide/own_filter.md") + code
    run("\n".join(code), tmp_path)
    if page == "README.md":
        assert (tmp_path / "angles.png").stat().st_size > 10_000


@pytest.mark.release
def test_the_filter_of_the_guide_finds_the_noise_that_made_its_data(tmp_path):
    code = "\n".join([*blocks("docs/guide/own_filter.md"), *blocks("docs/guide/tuning.md")])
    printed = run(code + "print(fit.params.gyroscope / true.gyroscope)", tmp_path)
    assert "(64,)" in printed
    assert "error_after" in printed
    assert abs(float(printed.split()[-1]) - 1.0) < 0.2


@pytest.mark.parametrize(
    "page, most", [("README.md", 120), ("CHANGELOG.md", 60), ("CONTRIBUTING.md", 60), ("docs/guide/all_sensors.md", 60)]
)
def test_a_page_that_everybody_reads_is_short(page, most):
    assert len((ROOT / page).read_text(encoding="utf-8").splitlines()) <= most
