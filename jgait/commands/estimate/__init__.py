"""`jgait estimate`: what an estimator says about recordings in files."""

from jgait.commands.estimate.command import estimate

__all__ = ["estimate"]
