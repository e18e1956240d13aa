"""Sensors that gait papers used. Each docstring states for every figure whether it is from a paper, from a data sheet,
or chosen here. Figures without a source were chosen; a study that depends on such a figure should vary it.
"""

import math

from jgait.geometry.vectors import GRAVITY
from jgait.simulate.person import DEGREE
from jgait.simulate.sensors.imu import ImuErrors
from jgait.simulate.sensors.range import Ranging

IDEAL = ImuErrors()
"""A perfect sensor, perfectly mounted."""

IDG300 = ImuErrors(
    gyr_noise=0.014 * math.sqrt(140.0 * math.pi / 2.0 / 25.0) * DEGREE,
    gyr_bias=1.0 * DEGREE,
    gyr_drift=0.01 * DEGREE,
    gyr_range=500.0 * DEGREE,
    gyr_resolution=2.5 / 4096 / 0.002 * DEGREE,
    acc_noise=160e-6 * GRAVITY,
    acc_bias=0.02 * GRAVITY,
    acc_range=6.0 * GRAVITY,
    acc_resolution=GRAVITY / 340.0,
    mounting=5.0 * DEGREE,
    packet_loss=0.01,
)
"""A Telos mote with an IDG-300 gyroscope and an LIS3LV02DQ accelerometer, sampled at 50 Hz.

Printed by Bennett, Jafari and Gans: both parts, ±500 °/s, 2 mV per °/s, 50 Hz. Data sheet of the LIS3LV02D family, as
distributors sum it up: ±6 g in 340 steps per g (the other setting is ±2 g in 1024, which Udaya Shankar and others print
for such boards). Chosen: a 12-bit converter of 2.5 V; gyroscope noise of 0.014 °/s/√Hz up to a first-order filter at
140 Hz, which sampling at 50 Hz folds into 25 Hz (0.2 °/s in all); accelerometer noise, biases, drift, mounting, loss.
"""

MPU6000 = ImuErrors(
    gyr_noise=0.005 * DEGREE,
    gyr_bias=0.5 * DEGREE,
    gyr_drift=0.01 * DEGREE,
    gyr_scale=0.01,
    gyr_range=1000.0 * DEGREE,
    gyr_resolution=DEGREE / 32.8,
    acc_noise=400e-6 * GRAVITY,
    acc_bias=0.02 * GRAVITY,
    acc_scale=0.01,
    acc_range=4.0 * GRAVITY,
    acc_resolution=GRAVITY / 8192.0,
    mounting=5.0 * DEGREE,
    packet_loss=0.01,
)
"""An InvenSense MPU-6000 as Silva, Afonso and Rocha wore it at the ankle, sampled at 100 Hz.

Printed by them: ±1000 °/s, ±4 g, 100 Hz. Data sheet (PS-MPU-6000A-00, revision 3.4): 32.8 steps per °/s, 8192 steps per
g, 0.005 °/s/√Hz at 10 Hz, 400 µg/√Hz. Chosen: a third of the data sheet's tolerance of scale (±3 %) as one standard
deviation; biases as a calibration at rest leaves them (before it the data sheet allows ±20 °/s and ±50 mg, ±80 mg along
z); drift, mounting, loss; no low-pass (it can be set between 5 and 256 Hz, and the paper does not state it).
"""

ON_SHOE = MPU6000._replace(
    gyr_range=2000.0 * DEGREE,
    gyr_resolution=4000.0 / 2**16 * DEGREE,
    acc_range=16.0 * GRAVITY,
    acc_resolution=32.0 / 2**16 * GRAVITY,
    packet_loss=0.0,
    sway=0.05,
    sway_arm=0.06,
    acc_jolt=1.0,
)
"""An MPU-6000 with its widest ranges, on a shoe: in stance the shoe is not quite at rest, and landings shake it.

Data sheet: the ranges, in 16 bits. `sway` and `acc_jolt` were chosen so that a simulated shoe turns as much in stance,
and is shaken as much from 20 to 45 Hz, as recorded shoes of `walking5m`, `gaitmap_example`, `footprints` and
`neura_sparse` (`experiments/people/shoes.py` prints both). Chosen: the height above the point about which it sways. No
samples are lost, because such sensors store them.
"""

OPAL = ImuErrors(
    gyr_noise=0.01 * DEGREE,
    gyr_bias=0.2 * DEGREE,
    gyr_drift=0.005 * DEGREE,
    gyr_scale=0.003,
    gyr_bandwidth=50.0,
    gyr_range=2000.0 * DEGREE,
    gyr_resolution=4000.0 / 2**16 * DEGREE,
    acc_noise=5e-3 * GRAVITY,
    acc_bias=0.03 * GRAVITY,
    acc_scale=0.003,
    acc_bandwidth=50.0,
    acc_range=200.0 * GRAVITY,
    acc_resolution=400.0 / 2**12 * GRAVITY,
    mounting=5.0 * DEGREE,
)
"""An APDM Opal on the instep, with the accelerometer of wide range, sampled at 128 Hz.

Printed in Potter's paper on stride width: ±200 g, ±2000 °/s, 128 Hz. Chosen: everything else. The steps are those of
12 and 16 bits, the accelerometer's noise that of a part made for 200 g; no source for them was available.
"""

HC_SR04 = Ranging(
    rate_hz=30.0,
    noise=0.002,
    half_angle=15.0 * DEGREE,
    min_distance=0.02,
    max_distance=4.0,
    outlier=0.02,
    outlier_size=0.3,
)
"""An HC-SR04 ultrasonic sensor at the ankle, looking at the other leg.

Printed in Potter's paper on stride width: 30 Hz, 0.2 cm, 2 to 400 cm; distances above 0.5 m were thrown away as errors
or other objects, hence late echoes. Vendors' sheets: a measuring angle of 15°, by some of 30°; taken as 15° to each
side. Chosen: probability and size of late echoes.
"""
