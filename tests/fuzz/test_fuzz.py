"""Damaged files of every format: none raises anything but the readers' own error, or takes long, or much memory."""

import pytest

from experiments.damage import fuzz
from experiments.damage.samples import samples

FORMATS = ("csv", "gaitmap", "mtw", "dot", "shimmer", "xio", "physilog", "opensim", "bids", "bids_gz", "parquet",
           "mobilised", "mobilised_plain", "apdm", "apdm_old", "params")  # fmt: skip
QUICK = 10


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return samples(tmp_path_factory.mktemp("samples"))


def check(made, format, number):
    every = fuzz.outcomes(format, made[format], number)
    assert [one for one in every if one.kind not in ("read", "refused")] == []
    assert any(one.kind == "refused" for one in every)


def test_every_format_is_there(made):
    assert set(made) == set(FORMATS)


@pytest.mark.parametrize("format", FORMATS)
def test_the_sample_is_read_and_damage_is_refused(made, format, tmp_path):
    assert fuzz.outcome(made[format], made[format].files, tmp_path) == fuzz.Outcome("read", "")
    check(made, format, QUICK)


@pytest.mark.release
@pytest.mark.parametrize("format", FORMATS)
def test_no_damage_gets_through(made, format):
    check(made, format, fuzz.EACH)


def test_what_a_reader_must_not_do_is_detected(made, tmp_path):
    def raises(path):
        raise KeyError(path.name)

    def waits(path):
        while True:
            path.read_bytes()

    sample = made["csv"]
    assert fuzz.outcome(sample._replace(read=raises), sample.files, tmp_path).kind == "traceback"
    before = fuzz.LONGEST_S
    try:
        fuzz.LONGEST_S = 0.1
        assert fuzz.outcome(sample._replace(read=waits), sample.files, tmp_path).kind == "hang"
    finally:
        fuzz.LONGEST_S = before
    taken = fuzz.outcome(
        sample._replace(read=lambda path: len(bytearray(b"1") * 1_300_000_000)), sample.files, tmp_path
    )
    assert taken.kind == "memory"
