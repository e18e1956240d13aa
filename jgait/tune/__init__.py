"""Parameters from data, by gradient: fit them, cross-validate the fit, and say what the data can determine."""

from jgait.tune.fit import Fit, Progress, fit
from jgait.tune.gradient import FORWARD_UP_TO, GRADIENTS, value_and_grad

__all__ = ["FORWARD_UP_TO", "GRADIENTS", "Fit", "Progress", "fit", "value_and_grad"]
