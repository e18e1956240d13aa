r"""Kalman filtering as one scan of predict and update; `step` runs the same step online, one sample at a time.

    predict   m⁻ = f(m) ⊕ v,        P⁻ = A P Aᵀ + Ω + Q
    update    S = H P⁻ Hᵀ + Ω + R,  K = P⁻ Hᵀ S⁻¹,  m = m⁻ ⊕ K (y − ŷ),  P = (I − K H) P⁻ (I − K H)ᵀ + K (R + Ω) Kᵀ

All equations are in error coordinates δ about the predicted state, so rotations need no special case. An iterated
update is linearised at the result of the previous iteration, but always updates the same prior.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PyTree

from jgait.filtering import checks
from jgait.filtering.compile import compiled
from jgait.filtering.covariance import Covariance
from jgait.filtering.execution import Execution, chosen, filtered
from jgait.filtering.fast import with_gradient_of
from jgait.filtering.hidden import without_hidden
from jgait.filtering.inputs import Inputs, inputs
from jgait.filtering.methods import EKF, Method
from jgait.filtering.model import Belief, Model
from jgait.types import Counts, Maybe, Values


class Updated(NamedTuple):
    """The result of one update: the belief after the observation, and the fields of `Posterior` at this sample."""

    belief: Belief
    innovation: PyTree
    innovation_stddev: PyTree
    log_likelihood: PyTree
    nis: PyTree
    count: PyTree
    valid: PyTree


class Step(NamedTuple):
    """One predict and update: the prediction, and the update."""

    predicted: Belief
    updated: Updated

    @property
    def belief(self) -> Belief:
        """The belief after the sample, the input of the next step."""
        return self.updated.belief


class Posterior(NamedTuple):
    """A filtered recording; every leaf has the time axis in front, and a field not in `keep` is None.

    Attributes:
        mean: filtered mean, in the state's type.
        cov: covariance of `mean`.
        predicted_mean: mean before each sample.
        predicted_cov: covariance of `predicted_mean`.
        innovation: measured − predicted, in the observation's type; 0 where masked.
        innovation_stddev: standard deviation of `innovation`, in the observation's type; 1 where masked.
        log_likelihood: (T,) log-density of each sample given the past [nat], linearised at the prediction; NaN if a
            parameter is NaN.
        nis: (T,) normalised innovation squared, χ² with `count` degrees of freedom, linearised at the prediction.
        count: (T,) number of measured components, as a float.
        valid: (T,) False where the numbers were not finite and the prediction was kept; the five fields above are
            then 0.
    """

    mean: PyTree = None
    cov: PyTree = None
    predicted_mean: PyTree = None
    predicted_cov: PyTree = None
    innovation: PyTree = None
    innovation_stddev: PyTree = None
    log_likelihood: Maybe[Float[Array, "*batch time"]] = None
    nis: Maybe[Float[Array, "*batch time"]] = None
    count: PyTree = None
    valid: Maybe[Bool[Array, "*batch time"]] = None

    def belief(self, at: Counts) -> Belief:
        """The belief after sample `at`."""
        return Belief(*jax.tree.map(lambda leaf: leaf[at], (self.mean, self.cov)))

    def student_t(self, freedom: float) -> Float[Array, "*batch time"]:
        """(T,) log-density of each sample [nat] under Student's t with the innovation's covariance for its scale.

        With few degrees of freedom, samples far from their prediction count little; with many it is `log_likelihood`.
        """
        size = self.count
        log_det = -2.0 * self.log_likelihood - self.nis - size * math.log(2.0 * math.pi)
        constant = jax.lax.lgamma(0.5 * (freedom + size)) - math.lgamma(0.5 * freedom)
        constant -= 0.5 * size * math.log(math.pi * freedom)
        return constant - 0.5 * log_det - 0.5 * (freedom + size) * jnp.log1p(self.nis / freedom)


FIELDS = Posterior._fields
"""The names of the fields that a filter can return, see `Posterior`."""

KEEP = ("mean", "cov", "innovation", "log_likelihood", "nis", "count", "valid")
"""The fields of a posterior that a filter returns by default."""


def step(
    model: Model, params: PyTree, belief: Belief, observation: PyTree, *, control: PyTree = None, dt: Values = 1.0,
    mask: PyTree = None, method: Method = EKF(),
) -> Step:  # fmt: skip
    """Predict over dt, then update: one sample online, jitted; `kalman_filter` scans the same step.

    Arguments as of `kalman_filter`, with scalars for arrays: `belief` is that after the previous sample, `dt` the time
    since then [s].

    Returns:
        Prediction and update; `.belief` is the input of the next step.

    Raises:
        ValueError: if an argument does not have the type that the model needs, or the observation has NaN.
    """
    checks.check_arguments(model, method, (), FIELDS)
    checks.check_values(observation, control, dt)
    model, observation, mask = without_hidden(model, observation, mask)
    return _step(model, params, belief, observation, control, dt, mask, method)


def _stepped(
    model: Model,
    params: PyTree,
    belief: Belief,
    observation: PyTree,
    control: PyTree,
    dt: Values,
    mask: PyTree,
    method: Method,
) -> Step:
    def alone(tree: PyTree) -> PyTree:
        return jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], tree)

    given = inputs(model, params, alone(observation), alone(control), dt, alone(mask), belief)
    sample = posterior(given, filtered(given, method, FIELDS, "core", segments=False))
    sample = jax.tree.map(lambda leaf: leaf[0], sample)
    updated = Updated(
        Belief(sample.mean, sample.cov), sample.innovation, sample.innovation_stddev, sample.log_likelihood, sample.nis,
        sample.count, sample.valid,
    )  # fmt: skip
    return Step(Belief(sample.predicted_mean, sample.predicted_cov), updated)


_step = compiled(_stepped, static_argnames=("model", "method"))


def kalman_filter(
    model: Model,
    params: PyTree,
    observations: PyTree,
    *,
    controls: PyTree = None,
    dt: Values = 1.0,
    mask: PyTree = None,
    method: Method = EKF(),
    initial: Belief | None = None,
    keep: tuple[str, ...] = KEEP,
    execution: Execution = "auto",
) -> Posterior:
    """Filter a recording: a jitted scan over its samples.

    Args:
        model: state-space model; functions at module level, since the model is a static argument of `jax.jit`.
        params: any pytree, passed on to the model's functions; differentiable.
        observations: observation tuple of (T,) arrays; a masked component may be any finite number.
        controls: control tuple of (T,) arrays, or None; entry k acts over the interval that ends at sample k.
        dt: interval [s], scalar or (T,); dt[k] is the time from sample k−1 to k, so dt[0] = 0 puts the initial
            belief at the first sample. At the end, samples with an interval of 0 and no measurement are padding:
            they cost nothing, and their results are those of the last sample before them.
        mask: observation tuple of (T,) bools, one (T,) bool for whole samples, or None. A leaf that is Python's False
            removes its component from the model, which is faster; the component is None in innovations.
        method: `KF()`, `EKF()`, `IteratedEKF(k)`, `UKF()` or `CKF()`.
        initial: belief before the first interval; None: the model's `initial`.
        keep: fields of `Posterior` to return; other fields are neither computed nor stored.
        execution: the computation, see `jgait.filtering.execution`; results agree up to rounding.

    Returns:
        The posterior, every leaf with the time axis in front, in the widest float type of parameters, observations
        and initial belief.

    Raises:
        ValueError: if observations, controls, mask or dt have wrong types or shapes, or observations have NaN.
    """
    checks.check_arguments(model, method, keep, FIELDS, execution)
    checks.check_values(observations, controls, dt)
    model, observations, mask = without_hidden(model, observations, mask)
    return _filter(model, params, observations, controls, dt, mask, initial, method, tuple(keep), execution)


def _filtered(
    model: Model,
    params: PyTree,
    observations: PyTree,
    controls: PyTree,
    dt: Values,
    mask: PyTree,
    initial: Belief | None,
    method: Method,
    keep: tuple[str, ...],
    execution: Execution,
) -> Posterior:
    def run(
        segments: bool, params: PyTree, recording: tuple[PyTree, PyTree, PyTree, PyTree], initial: PyTree
    ) -> Posterior:
        given = inputs(model, params, *recording, initial)
        return posterior(given, filtered(given, method, keep, execution, segments))

    recording = observations, controls, dt, mask
    if chosen(inputs(model, params, *recording, initial), method, execution) == "core":
        return run(False, params, recording, initial)
    return with_gradient_of(partial(run, False), partial(run, True))(params, recording, initial)


_filter = compiled(_filtered, static_argnames=("model", "method", "keep", "execution"))


def posterior(given: Inputs, kept: dict[str, Any]) -> Posterior:
    """The posterior from the fields that a scan returned."""
    cm, params = given.cm, [leaf for leaf in jax.tree.leaves(given.params) if jnp.issubdtype(leaf.dtype, jnp.floating)]
    if "log_likelihood" in kept and params:
        # No update is valid, and none counts: the sum would be 0.
        lost = jnp.any(jnp.stack([jnp.any(jnp.isnan(leaf)) for leaf in params]))
        kept = kept | {"log_likelihood": jnp.where(lost, jnp.nan, kept["log_likelihood"])}
    named = dict.fromkeys(("mean", "predicted_mean"), cm.state.unflatten)
    named |= dict.fromkeys(("innovation", "innovation_stddev"), cm.observed.unflatten)
    named |= dict.fromkeys(("cov", "predicted_cov"), partial(named_covariance, structure=cm.error))
    return Posterior(**{name: named[name](values) if name in named else values for name, values in kept.items()})


def named_covariance(values: PyTree, structure: PyTree) -> Covariance:
    """The upper triangle as a list, or an array (..., n, n), as a `Covariance`."""
    matrix = Covariance(tuple(values), structure).dense() if isinstance(values, list) else values
    return Covariance.from_dense(matrix, structure)
