"""The range between the feet in an analysis of all sensors."""

import jax
import pytest

import jgait
from experiments.common import protocols


@pytest.fixture(scope="module")
def recording():
    return protocols.potter(jax.random.key(0), straight=10.0, after=4.0)[0].recording


def test_a_default_offset_of_the_range_is_named_where_a_range_is_used(recording):
    silent = recording.feet_range._replace(mask=recording.feet_range.mask & False)
    with_default, given, unused = (
        [note for note in jgait.analyse(one, {"height": 1.75, **more}).notes if note.code == "range_offset_absent"]
        for one, more in (
            (recording, {}),
            (recording, {"range_offset": 0.09}),
            (recording._replace(feet_range=silent), {}),
        )
    )
    assert [note.values for note in with_default] == [{"offset": 0.08}]
    assert not given and not unused
