"""What data left out say of a tuning: which of several is taken, and how many independent errors there are."""

from collections.abc import Hashable, Mapping, Sequence

import numpy as np


def simplest[Name: Hashable](losses: Mapping[Name, np.ndarray], groups: Sequence[Hashable] | np.ndarray) -> Name:
    """The first candidate whose mean loss is at most one standard error above the best one's.

    Source: L. Breiman et al., "Classification and Regression Trees", 1984, section 3.4.3.

    Args:
        losses: candidate → loss of every item left out; candidates from the simplest on.
        groups: the person or day of each item, which its errors share: the standard error is that of the paired
            difference to the best candidate over groups, each weighted by its items.
    """
    best = min(losses, key=lambda name: float(np.mean(losses[name])))
    labels = np.asarray(groups)
    for name, loss in losses.items():
        more = loss - losses[best]
        sums = np.array([more[labels == label].sum() - more.mean() * np.sum(labels == label)
                         for label in dict.fromkeys(labels.tolist())])  # fmt: skip
        spread = np.sqrt(np.sum(sums**2) * sums.size / max(sums.size - 1, 1)) / more.size
        if name == best or more.mean() <= spread:
            return name
    return best


def independent(errors: np.ndarray, groups: np.ndarray) -> float:
    """How many independent errors one counts for, (0, 1]: 1 / (1 + (m − 1) ρ) for m errors a person.

    ρ is the correlation of two errors of a person, from the mean squares between and within persons: L. Kish, "Survey
    Sampling", 1965. With it the priors of a fit weigh as much as if all errors were independent.
    """
    labels, row = np.unique(groups, return_inverse=True)
    count = np.bincount(row)
    mean = np.bincount(row, errors) / count
    within = np.sum((errors - mean[row]) ** 2) / (errors.size - labels.size)
    between = np.sum(count * (mean - errors.mean()) ** 2) / (labels.size - 1)
    size = (errors.size - np.sum(count**2) / errors.size) / (labels.size - 1)
    rho = max((between - within) / (between + (size - 1.0) * within), 0.0)
    return float(1.0 / (1.0 + (size - 1.0) * rho))
