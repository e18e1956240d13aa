"""The leg estimator on ten thousand walks of a minute, from disk: time, memory, errors."""

PARTS = ("timed", "same", "late")
