"""Simulated people beside recorded ones: figures of gait, spectra of signals, and a classifier of strides.

Every recorded person has a simulated one who walks at the same stride time and length with a manner drawn from
`simulate.population`. Nothing of the simulator is tuned by these parts. Further parts: whether estimators err on
simulated people as on recorded ones, what they measure in gaits that are not the usual one, how still shoes are in
stance, what is tuned on simulated people alone, where recorded people wear their sensors, and what simulated people
cost.
"""

PARTS = ("figures", "strides", "prediction", "fitted", "gaits", "shoes", "mounts", "transfer", "cost")
