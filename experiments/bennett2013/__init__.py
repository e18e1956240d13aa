"""The leg EKF of Bennett et al. (2013): Table II in simulation, and what it reaches on real recordings."""

PARTS = ("table2", "neura_sparse", "walking5m")
