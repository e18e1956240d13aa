"""What every data set on this computer keeps."""

import numpy as np
import pytest

from jgait import datasets
from jgait.estimators import checks


@pytest.mark.parametrize("name", datasets.list_datasets())
def test_every_recording_gives_a_walk(data, name):
    walks = data(name)
    again = datasets.repeated(name)
    if again:
        assert not {walk.recording.name for walk in walks} & set(again)
        walks = data(name, *datasets.names(name))
    assert walks.failures == ()
    assert {walk.recording.name for walk in walks} == set(datasets.names(name))
    for walk in walks:
        assert (walk.reference is None) == bool(walk.info.get("no_reference"))
        for imu in walk.recording.sensors.values():
            assert all(np.isfinite(part).all() for part in imu if part is not None)
            assert len({len(part) for part in imu if part is not None}) == 1
            assert checks.fast_rate(imu) < 0.5 * checks.FASTEST and checks.force_unit(imu)[1] == ""  # no other unit
