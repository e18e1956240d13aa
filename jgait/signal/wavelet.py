r"""A signal rebuilt from the thresholded details of its stationary (à-trous) wavelet transform, as by pywavelets.

With the taps h (low-pass) and g (high-pass) of the wavelet, L of each, the level j of a signal a_0 of T samples is

    a_j[n] = Σ_k h[k] a_{j−1}[n − 2^{j−1} (k − L/2)],   d_j[n] = Σ_k g[k] a_{j−1}[n − 2^{j−1} (k − L/2)],

indices modulo T; no sample is dropped, so that a shifted signal has shifted details. The inverse is the mean over all
shifts of the decimated inverse,

    a_{j−1}[n] = ½ Σ_k (h̃[k] a_j[n − 2^{j−1} (k − L/2 + 1)] + g̃[k] d_j[n − 2^{j−1} (k − L/2 + 1)]).

The details of a level do not depend on the number of further levels. JAX, along the first axis.
"""

import functools
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
import pywt
from jaxtyping import Array, Bool, Float

from jgait.signal.windows import samples
from jgait.types import AnyArray, Scalar

MAGNITUDES = ("max", "rms")
"""Magnitude of a detail to which its threshold is relative: greatest absolute value, or root mean square."""


@functools.cache
def _taps() -> tuple[np.ndarray, ...]:
    """Low-pass and high-pass of the transform, and of its inverse; on the host."""
    return tuple(np.asarray(taps, np.float64) for taps in pywt.Wavelet("db5").filter_bank)


def _filtered(values: Float[Array, "time *rest"], taps: np.ndarray, spread: int, lead: int) -> Float[Array, "..."]:
    """Σ_k f[k] x[n − spread (k − lead)], indices modulo T.

    The delays are static: each delayed signal is a slice of the signal repeated twice, and XLA fuses them to one loop.
    """
    count = values.shape[0]
    delays = [(-spread * (k - lead)) % count for k in range(len(taps))]
    twice = jnp.concatenate([values, values[: max(delays)]])
    return functools.reduce(
        jnp.add, (float(tap) * twice[start : start + count] for tap, start in zip(taps, delays, strict=True))
    )


def _magnitude(values: Float[Array, "time *rest"], kind: str, mask: Bool[AnyArray, "time"]) -> Float[Array, "*rest"]:
    """Maximum of |x|, or √(mean x²), where the mask is True; 0 if it is nowhere, with a gradient of 0."""
    weight = jnp.asarray(mask).astype(values.dtype).reshape(-1, *[1] * (values.ndim - 1))
    if kind == "max":
        return jnp.max(jnp.abs(values) * weight, axis=0)
    square = (values * values * weight).sum(axis=0) / jnp.maximum(weight.sum(), 1.0)
    return jnp.where(square > 0.0, jnp.sqrt(jnp.where(square > 0.0, square, 1.0)), 0.0)


def from_details(
    x: AnyArray, shares: Sequence[Scalar] | Float[AnyArray, "level"], *, relative_to: str = "rms",
    hard: bool = False, mask: Bool[AnyArray, "time"] | None = None,
) -> Float[Array, "time *rest"]:  # fmt: skip
    """A signal rebuilt from its finest details alone, each thresholded at a share of the detail's magnitude.

    d_j → x where |x| > c_j |d_j| (hard), or sign(x) max(|x| − c_j |d_j|, 0) (soft), else 0;  a → 0, then the inverse.
    |d_j| is computed without the padding, by which both ends are reflected.

    Args:
        x: (T, ...) samples, floating point, any unit, finite.
        shares: c_1 … c_J, one for each detail level that is kept [1], J ≤ 10; their number is static.
        relative_to: one of `MAGNITUDES`; static.
        hard: whether thresholds are hard, which have no gradient in the shares; static.
        mask: (T,) bool, False where a sample does not count for the magnitudes; None: all count.

    Raises:
        ValueError: if there is no sample, they are not floating point, or there is no such magnitude.
    """
    if relative_to not in MAGNITUDES:
        raise ValueError(f"magnitude must be one of {', '.join(MAGNITUDES)}; got {relative_to!r}")
    values = jnp.asarray(samples(x))
    count, more = len(values), -len(values) % 1024  # up to ten levels need no other multiple
    before = more // 2
    counts = jnp.ones(count, bool) if mask is None else mask
    rest = jnp.pad(values, [(before, more - before)] + [(0, 0)] * (values.ndim - 1), mode="symmetric")
    low, high, back_low, back_high = _taps()
    lead, details = len(low) // 2, []
    for level, share in enumerate(shares):
        rest, detail = (_filtered(rest, taps, 2**level, lead) for taps in (low, high))
        limit = jnp.asarray(share, rest.dtype) * _magnitude(detail[before : before + count], relative_to, counts)[None]
        above = jnp.abs(detail) > limit
        details.append(jnp.where(above, detail if hard else detail - jnp.sign(detail) * limit, 0.0))
    rebuilt = jnp.zeros_like(rest)
    for level, detail in reversed(list(enumerate(details))):
        smooth, rough = (_filtered(part, taps, 2**level, lead - 1) for part, taps in
                         ((rebuilt, back_low), (detail, back_high)))  # fmt: skip
        rebuilt = 0.5 * (smooth + rough)
    return rebuilt[before : before + count]
