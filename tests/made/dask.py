"""A Dask cluster of two worker processes on this machine."""

import contextlib
import logging
import warnings
from collections.abc import Iterator
from typing import Any

import pytest
from made.process import environment


@contextlib.contextmanager
def two_workers(**settings: Any) -> Iterator[Any]:
    """A client of the cluster; `settings` are those of its scheduler. Skips the test if Dask is not installed."""
    distributed = pytest.importorskip("distributed")
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        # What JAX computes with comes with the task and not from here.
        for name, value in environment().items():
            patch.setenv(name, value)
        # Workers that are killed leave sockets and event loops behind, and say so late.
        warnings.simplefilter("ignore", ResourceWarning)
        warnings.filterwarnings("ignore", category=DeprecationWarning, module=r"(distributed|tornado|dask)\b.*")
        options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.CRITICAL}
        with (
            distributed.LocalCluster(**options, scheduler_kwargs=settings) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield client
