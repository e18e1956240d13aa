"""Noise models and other parameters tuned by gradient, judged on days, walks and people that the tuning left out."""

PARTS = ("vicon", "footprints", "pyshoe", "legs", "ankles", "contacts")
