"""Public sets written by a test: what is loaded, and what is refused."""

import re

from jgait import datasets


def loaded(name, *chosen):
    """The recordings of a set, all or some; none fails."""
    walks = datasets.load(name, chosen or None)
    assert walks.failures == ()
    return walks


def refused(name, good, expected):
    """A set loads the good recordings; the others fail for the expected reasons, patterns by name."""
    walks = datasets.load(name)
    assert [walk.recording.name for walk in walks] == list(good)
    reasons = dict(walks.failures)
    assert set(reasons) == set(expected)
    for which, reason in expected.items():
        assert re.search(reason, reasons[which]), reasons[which]
