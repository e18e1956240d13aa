"""Sensors of published studies: allowed, and as those papers and data sheets have them."""

import numpy as np

from jgait.simulate import sensors
from jgait.simulate.sensors import HC_SR04, IDEAL, IDG300, MPU6000, ON_SHOE, OPAL


def test_every_preset_is_allowed_and_converters_have_whole_bits():
    for errors in (IDEAL, IDG300, MPU6000, ON_SHOE, OPAL):
        sensors.check_errors(errors)
    sensors.check_ranging(HC_SR04)
    for errors, bits in ((MPU6000, (16, 16)), (ON_SHOE, (16, 16)), (OPAL, (16, 12))):
        steps = [2 * errors.gyr_range / errors.gyr_resolution, 2 * errors.acc_range / errors.acc_resolution]
        np.testing.assert_allclose(np.log2(steps), bits, atol=0.005)  # 32.8 and 0.0096 are printed rounded
