"""What holds for every estimator of the registry."""

import jax
import numpy as np
import pytest

from jgait import estimators, params
from jgait.estimators.ankle_stride.inputs import AnkleSignals, capacity
from jgait.estimators.axes import axes_of, pad
from jgait.estimators.leg_ekf.inputs import LegInputs


def is_transform(node):
    return isinstance(node, params.Transform)


@pytest.mark.parametrize("name", estimators.names())
def test_every_parameter_declares_range_unit_and_meaning(name):
    made = estimators.get(name)
    units = params.units(made.params)
    assert tuple(units) == params.names(made.transforms) and all(units.values())
    declared = params.declared(type(made.params))
    assert tuple(declared) == made.params._fields
    for field, one in declared.items():
        assert len(one.meaning) > 10 and f"    {field}: {one.meaning}" in type(made.params).__doc__
    params.check_params(made.params, made.transforms)
    assert jax.tree.structure(made.transforms, is_leaf=is_transform) == jax.tree.structure(made.params)


@pytest.mark.parametrize("name", estimators.names())
def test_every_option_is_documented(name):
    default = estimators.get(name).about.default
    for field in default._fields:
        assert f"\n        {field}: " in type(default).__doc__, field


def test_padding_follows_from_what_fields_state():

    axes = axes_of(AnkleSignals)
    assert axes["gyr"].fill == "hold" and axes["stands"].fill == "zero" and axes["gyr_bias"] is None
    assert axes["begin"].length(1000) == capacity(1000)
    time = 0.01 * np.arange(5)
    short = LegInputs(None, None, time, np.full(5, 0.01), np.zeros(5, bool), np.ones(5, bool), np.asarray(0.1))
    longer = pad(short, 8)
    np.testing.assert_allclose(longer.time, 0.01 * np.arange(8))
    np.testing.assert_array_equal(longer.still, [False] * 5 + [True] * 3)
    np.testing.assert_array_equal(longer.valid, [True] * 5 + [False] * 3)
    assert longer.start_variance == 0.1 and longer.right is None
    with pytest.raises(ValueError, match="pad only lengthens; got 5 samples and 4 wanted"):
        pad(short, 4)
