"""The walking simulator: checks against its own truth, speed, and simulated gait beside real gait."""

PARTS = ("checks", "cohort", "against_real")
