"""Estimators sample by sample, behind one object: `online` makes it, `Online.push` takes samples and tells what is new.

`device` runs an estimator in a compiled loop, `export` writes it as a program that runs without jgait; `legs` and
`duty` give angles; `samples` checks samples; `session` joins them with the strides of feet, ankles and shanks.
"""

from jgait.estimators.online.device import Device
from jgait.estimators.online.export import ExportedStep
from jgait.estimators.online.session import CAUSAL, NewContacts, News, NewStrides, Online, online

__all__ = ["CAUSAL", "Device", "ExportedStep", "NewContacts", "NewStrides", "News", "Online", "online"]
