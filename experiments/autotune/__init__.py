"""Noise models of the foot estimator tuned by gradient: positions under Vicon by days left out, other sets, PyShoe."""

PARTS = ("vicon", "footprints", "pyshoe")
