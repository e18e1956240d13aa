"""A device as two programs that run without jgait: StableHLO, by `jax.export`, of one sample at a time.

`begin` makes the state from the first sample; `step` takes it over each sample, the first one too. In them are the
filter, the detectors of standing and stances, and the read-out. What jgait does on the host is not: the calibration,
whose results are `constants`; the checks of samples and the filling of gaps by `Online.push`; the sum of strides.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from jgait.estimators.online.device import Device, Readings
from jgait.geometry.arrays import host
from jgait.notes import record

PLATFORMS = ("cpu", "cuda", "rocm", "tpu")
"""Where the programs run."""

SAMPLE = ("dt", "gyr", "acc", "gyr_measured", "acc_measured")
"""Names of the fields of `Readings` in the programs' samples."""

EXAMPLE = '''"""Run {source} without jgait: python {source}_example.py SAMPLES.npz; {source}.json says what is in it."""

import sys
from pathlib import Path

import jax
import numpy as np

jax.config.update("jax_enable_x64", {double})
here, samples, results = Path(__file__).parent, np.load(sys.argv[1]), []
begin, step = (jax.export.deserialize((here / f"{source}_{{name}}.bin").read_bytes()) for name in ("begin", "step"))
constants, run = list(np.load(here / "{source}_constants.npz").values()), jax.jit(step.call)
for number in range(len(samples["dt"])):
    sample = {{name: samples[name][number] for name in samples}}
    state = state if number else begin.call(constants, sample)
    state, result = run(constants, state, sample)
    results.append(result)
print(result)
'''
"""A file that runs the programs; it needs jax, flatbuffers and numpy alone."""


@record
class ExportedStep(NamedTuple):
    """The step of an estimator online, made by `Online.export`.

    A sample is a dictionary of `dt` () [s] since the previous sample, 0 at the first; `gyr` (k, 3) [rad/s] and `acc`
    (k, 3) [m/s²] of the k sensors in their own axes; `gyr_measured` and `acc_measured` (k,), False where a reading was
    lost. Results are the fields of `LegsNow`, or of `LaggedNow`, by name.
    """

    device: Device  #: the estimator, with its sensors and constants.
    begin: jax.export.Exported  #: (constants, sample) → state before the first sample, a list of arrays.
    step: jax.export.Exported  #: (constants, state, sample) → state and results.
    constants: list[np.ndarray]  #: parameters and calibration of the person.
    sampling_rate_hz: float  #: rate of the samples [Hz].
    state_bytes: int  #: memory of the state [bytes].
    operations: int  #: floating-point operations of one sample, counted by XLA in the compiled step [1].

    def files(self) -> dict[str, str | bytes]:
        """Name → content of the files in which the step is kept, but for the constants: both programs as `jax.export`
        serialises them and as text, a description, and an example that runs them.

        Raises:
            ImportError: without flatbuffers, which `jgait[cli]` brings.
        """
        ((_, _, sample), _) = jax.tree.unflatten(self.step.in_tree, self.step.in_avals)
        source, real = self.device.source, sample["dt"].dtype
        about = {
            "source": source, "sensors": self.device.placements, "sampling_rate_hz": self.sampling_rate_hz,
            "sample": {name: [str(leaf.dtype), leaf.shape] for name, leaf in sample.items()},
            "units": {"dt": "s", "gyr": "rad/s", "acc": "m/s²"}, "sides": self.device.sides,
            "state_bytes": self.state_bytes, "operations_a_sample": self.operations,
        }  # fmt: skip
        programs = {"begin": self.begin, "step": self.step}
        return {
            **{f"{source}_{name}.bin": bytes(program.serialize()) for name, program in programs.items()},
            **{f"{source}_{name}.mlir": program.mlir_module() for name, program in programs.items()},
            f"{source}.json": json.dumps(about, indent=1, ensure_ascii=False) + "\n",
            f"{source}_example.py": EXAMPLE.format(source=source, double=real == np.float64),
        }

    def save(self, folder: str | Path) -> list[Path]:
        """Write `files` and the constants into a folder that exists; returns their paths."""
        files = {Path(folder) / name: content for name, content in self.files().items()}
        for path, content in files.items():
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        constants = Path(folder) / f"{self.device.source}_constants.npz"
        np.savez(constants, *self.constants)
        return [*files, constants]


def exported(device: Device, sampling_rate_hz: float) -> ExportedStep:
    """The step of a device, in JAX's float type of the moment."""
    constants, structure = jax.tree.flatten(jax.tree.map(jnp.asarray, device.constants))
    real, sensors = jnp.zeros(()).dtype, len(device.placements)
    kinds = (((), real), ((sensors, 3), real), ((sensors, 3), real), ((sensors,), bool), ((sensors,), bool))
    sample = {name: jax.ShapeDtypeStruct(*kind) for name, kind in zip(SAMPLE, kinds, strict=True)}

    def readings(sample: PyTree) -> Readings:
        return Readings(*(sample[name] for name in SAMPLE))

    def begin(constants: PyTree, sample: PyTree) -> PyTree:
        return device.begin(jax.tree.unflatten(structure, constants), readings(sample), device.options)

    before = jax.eval_shape(begin, constants, sample)
    state, states = jax.tree.flatten(before)

    def step(constants: PyTree, state: PyTree, sample: PyTree) -> tuple[PyTree, PyTree]:
        block = jax.tree.map(lambda leaf: leaf[None], readings(sample))
        known, before = jax.tree.unflatten(structure, constants), jax.tree.unflatten(states, state)
        after, results = device.advance(known, before, block, np.int32(1), device.options)
        kept = [jnp.asarray(new, old.dtype) for new, old in zip(jax.tree.leaves(after), state, strict=True)]
        return kept, jax.tree.map(lambda leaf: leaf[0], _named(results))

    def program(function: Any, *arguments: PyTree) -> jax.export.Exported:
        return jax.export.export(jax.jit(function), platforms=PLATFORMS)(*arguments)

    with jax.default_device(host() or jax.config.jax_default_device):
        cost: Any = jax.jit(step).lower(constants, state, sample).compile().cost_analysis()
        return ExportedStep(
            device, program(lambda *given: jax.tree.leaves(begin(*given)), constants, sample),
            program(step, constants, state, sample), [np.asarray(leaf) for leaf in constants], sampling_rate_hz,
            sum(leaf.size * leaf.dtype.itemsize for leaf in state), int(cost["flops"] + cost["transcendentals"]),
        )  # fmt: skip


def _named(tree: PyTree) -> PyTree:
    """Records as dictionaries without what is None, which `jax.export` writes; other containers as they are."""
    if hasattr(tree, "_asdict"):
        tree = tree._asdict()
    if isinstance(tree, dict):
        return {name: _named(inner) for name, inner in tree.items() if inner is not None}
    return tree
