"""How an experiment and a library in an environment of its own speak: jobs in one .npz, results in another.

Needs nothing but NumPy, for both sides read it. An array is stored as "job/array".
"""

import sys

import numpy as np


def save(path, jobs):
    """Write {job: {array: values}}."""
    np.savez(path, **{f"{job}/{name}": values for job, arrays in jobs.items() for name, values in arrays.items()})


def load(path):
    """Read what `save` wrote."""
    jobs = {}
    with np.load(path, allow_pickle=False) as file:
        for key in file.files:
            job, name = key.rsplit("/", 1)
            jobs.setdefault(job, {})[name] = file[key]
    return jobs


def main(function):
    """Answer every job of the file named first with `function(**arrays)`, into the file named second."""
    source, target = sys.argv[1:]
    save(target, {job: function(**arrays) for job, arrays in load(source).items()})
