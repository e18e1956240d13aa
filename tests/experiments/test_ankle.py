"""What the ankle experiment finds on real legs: every stride, exchanged sensors, and lengths held out."""

import pytest

from experiments.common import shanks as legs
from experiments.silva2017 import detect, groups, lengths, methods

pytestmark = pytest.mark.release


def test_every_stride_of_the_reference_walk_and_its_length(data):
    data("neura_sparse")
    found = legs.legs("neura_sparse")
    for half_steps in (False, True):
        scores = [detect.score(leg, detect.strides_of(leg).end, half_steps=half_steps) for leg in found]
        assert detect.f1(scores) == 1.0
    for group, limit in (("neura_ankle", 1.5), ("neura_shank", 3.5)):
        of = [leg for leg in found if leg.group == group]
        s = lengths.stacked([lengths.signals(leg) for leg in of])
        told, fits = methods.held_out(s, groups.keys("neura", of), "3-D")
        assert lengths.errors(told, s).mae_cm < limit
        assert all(0.0 < fit.height < 0.3 for fit in fits)
        bare = lengths.errors(lengths.lengths("3-D", lengths.with_lever(0.0), lengths.CUTOFF_HZ, s), s)
        assert bare.mae_cm > lengths.errors(told, s).mae_cm


def test_exchanged_sensors_are_noticed_without_their_names(data):
    walks = {walk.recording.name for walk in data("walking5m")}
    wanted = tuple(sorted(walks & {"Elderly/20180417_2", "Elderly/20180403_3"}))
    if len(wanted) < 2:
        pytest.skip("the recordings with and without exchanged sensors are not here")
    found = legs.legs("walking5m", wanted)
    noticed = [(leg.walk, leg.side) for leg in found if leg.notes]
    assert noticed == [("Elderly/20180417_2", "left")]
    assert detect.f1([detect.score(leg, detect.strides_of(leg).end, half_steps=True) for leg in found]) == 1.0
