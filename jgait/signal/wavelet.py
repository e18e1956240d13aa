r"""Stationary (à-trous) wavelet transforms, their inverse, and signals rebuilt from thresholded details.

With a wavelet's taps h (low-pass) and g (high-pass), L of each, the level j of a signal a_0 of T samples is

    a_j[n] = Σ_k h[k] a_{j−1}[n − 2^{j−1} (k − L/2)],   d_j[n] = Σ_k g[k] a_{j−1}[n − 2^{j−1} (k − L/2)],

indices modulo T; no sample is dropped, so that a shifted signal has shifted details. The inverse is the mean over all
shifts of the decimated inverse,

    a_{j−1}[n] = ½ Σ_k (h̃[k] a_j[n − 2^{j−1} (k − L/2 + 1)] + g̃[k] d_j[n − 2^{j−1} (k − L/2 + 1)]).

Taps come from pywavelets, on the host; results equal those of `pywt.swt` and `pywt.iswt`. Everything else is JAX, along
the first axis, usable under `jit`, `vmap` and `grad`; wavelet and levels are static. Details 1 to 3 do not depend on
the number of further levels, so the signal rebuilt from them is the same with three levels as with ten.
"""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pywt
from jaxtyping import Array, Bool, Float

from jgait.signal.windows import samples
from jgait.types import AnyArray, Scalar, Values

MAGNITUDES = ("max", "rms")
"""Magnitude of a detail to which its threshold is relative: greatest absolute value, or root mean square."""

WAVELET = "db5"
"""pywavelets' name of the wavelet of `from_details`."""

MULTIPLE = 1024
"""[samples] Signals are padded to a multiple of this length before thresholding; ten levels need 1024."""


class Decomposition(NamedTuple):
    """A signal over several scales; every field has the signal's shape and unit."""

    approximation: Float[AnyArray, "time *rest"]  #: (T, ...) approximation at the coarsest level.
    details: tuple[Float[AnyArray, "time *rest"], ...]  #: one (T, ...) for each level, the finest (level 1) first.


class Taps(NamedTuple):
    """Filters of a wavelet, of equal and even length: of the transform (`dec`) and of its inverse (`rec`)."""

    dec_lo: Float[np.ndarray, "tap"]
    dec_hi: Float[np.ndarray, "tap"]
    rec_lo: Float[np.ndarray, "tap"]
    rec_hi: Float[np.ndarray, "tap"]


@functools.cache
def taps(wavelet: str) -> Taps:
    """The filters of a wavelet of pywavelets, such as "db5", "sym4", "bior2.4"; on the host.

    Raises:
        ValueError: if there is no discrete wavelet of that name.
    """
    if wavelet not in pywt.wavelist(kind="discrete"):
        raise ValueError(f"wavelet must be one of pywt.wavelist(kind='discrete'); got {wavelet!r}")
    return Taps(*(np.asarray(bank, np.float64) for bank in pywt.Wavelet(wavelet).filter_bank))


def _filtered(
    values: Float[Array, "time *rest"], filters: Sequence[Float[np.ndarray, "tap"]], spread: int, lead: int
) -> list[Float[Array, "time *rest"]]:
    """Σ_k f[k] x[n − spread (k − lead)] for every filter, indices modulo T.

    The delays are static: each delayed signal is a slice of the signal repeated twice, and XLA fuses them to one loop.
    """
    count = values.shape[0]
    delays = [(-spread * (k - lead)) % count for k in range(len(filters[0]))]
    twice = jnp.concatenate([values, values[: max(delays)]])
    windows = [twice[start : start + count] for start in delays]
    return [
        functools.reduce(jnp.add, (float(tap) * window for tap, window in zip(f, windows, strict=True) if tap != 0.0))
        for f in filters
    ]


def transform(x: AnyArray, wavelet: str, levels: int) -> Decomposition:
    """The stationary wavelet transform of (T, ...) finite samples, as `pywt.swt`, details finest first.

    Raises:
        ValueError: if there is no such wavelet or level, or the length is no multiple of 2^levels.
    """
    filters, values = taps(wavelet), jnp.asarray(samples(x))
    if levels < 1:
        raise ValueError(f"levels must be at least 1; got {levels}")
    if values.shape[0] % 2**levels:
        raise ValueError(
            f"{levels} levels need a multiple of {2**levels} samples along the first axis; got {values.shape[0]} "
            f"(see wavelet.padded)"
        )
    lead, details = len(filters.dec_lo) // 2, []
    for level in range(levels):
        values, detail = _filtered(values, (filters.dec_lo, filters.dec_hi), 2**level, lead)
        details.append(detail)
    return Decomposition(values, tuple(details))


def inverse(t: Decomposition, wavelet: str) -> Float[Array, "time *rest"]:
    """The signal (T, ...) of a transform by the same wavelet, as `pywt.iswt`.

    For changed coefficients it is the mean over all shifts (see the module).

    Raises:
        ValueError: if there is no such wavelet, or the shapes do not belong together.
    """
    filters, values = taps(wavelet), jnp.asarray(samples(t.approximation))
    shapes = {np.shape(part) for part in (values, *t.details)}
    if not t.details or len(shapes) > 1 or values.shape[0] % 2 ** len(t.details):
        raise ValueError(
            f"a transform holds at least one detail, all of the approximation's shape, a multiple of 2^levels samples "
            f"long; got {len(t.details)} details and the shapes {sorted(shapes)}"
        )
    lead = len(filters.rec_lo) // 2 - 1
    for level in reversed(range(len(t.details))):
        smooth = _filtered(values, (filters.rec_lo,), 2**level, lead)[0]
        rough = _filtered(jnp.asarray(t.details[level]), (filters.rec_hi,), 2**level, lead)[0]
        values = 0.5 * (smooth + rough)
    return values


def padded(x: AnyArray) -> tuple[Float[Array, "padded *rest"], int]:
    """The signal (T, ...), T > 0, with both ends continued by reflection that repeats the edge, to the next `MULTIPLE`.

    Returns:
        The padded signal, and the number of samples added before the first; half of all added samples, rounded down.
    """
    values = jnp.asarray(samples(x))
    more = -values.shape[0] % MULTIPLE
    before = more // 2
    sides = [(before, more - before)] + [(0, 0)] * (values.ndim - 1)
    return jnp.pad(values, sides, mode="symmetric"), before


def magnitude(
    x: Float[AnyArray, "time *rest"], kind: str, mask: Bool[AnyArray, "time"] | None = None
) -> Float[Array, "*rest"]:
    """The magnitude of a signal, max |x| or √(mean x²), along the first axis.

    Args:
        x: (T, ...) samples, any unit.
        kind: one of `MAGNITUDES`; static.
        mask: (T,) bool, False where a sample is ignored; None: all count.

    Returns:
        (...) in the signal's unit; 0 if no sample counts. A magnitude of 0 has a gradient of 0.

    Raises:
        ValueError: if there is no such magnitude.
    """
    if kind not in MAGNITUDES:
        raise ValueError(f"magnitude must be one of {', '.join(MAGNITUDES)}; got {kind!r}")
    values = jnp.asarray(samples(x))
    counts = jnp.ones_like(values[:, *[0] * (values.ndim - 1)]) if mask is None else jnp.asarray(mask)
    weight = counts.astype(values.dtype).reshape(-1, *[1] * (values.ndim - 1))
    if kind == "max":
        return jnp.max(jnp.abs(values) * weight, axis=0)
    square = (values * values * weight).sum(axis=0) / jnp.maximum(weight.sum(), 1.0)
    return jnp.where(square > 0.0, jnp.sqrt(jnp.where(square > 0.0, square, 1.0)), 0.0)


def threshold(x: Values, limit: Values, *, hard: bool) -> Float[Array, "..."]:
    """The part of a signal above a limit: x where |x| > limit (hard), sign(x) max(|x| − limit, 0) (soft), else 0.

    Args:
        x: (...) any unit.
        limit: as many axes as `x`, or none, and the same unit.
        hard: whether the threshold is hard; static.

    Returns:
        The same shape. A hard threshold has no gradient in its limit; a soft one has.
    """
    values, least = jnp.asarray(x), jnp.asarray(limit)
    above = jnp.abs(values) > least
    return jnp.where(above, values if hard else values - jnp.sign(values) * least, 0.0)


def from_details(
    x: AnyArray, shares: Sequence[Scalar] | Float[AnyArray, "level"], *, relative_to: str = "rms",
    hard: bool = False, mask: Bool[AnyArray, "time"] | None = None,
) -> Float[Array, "time *rest"]:  # fmt: skip
    """A signal rebuilt from its finest details alone, each thresholded at a share of the detail's magnitude.

    d_j → threshold(d_j, c_j |d_j|), a → 0, then the inverse; |d_j| is computed without the padding.

    Args:
        x: (T, ...) samples, floating point, any unit, finite.
        shares: c_1 … c_J, one for each detail level that is kept [1]; their number is static.
        relative_to: one of `MAGNITUDES`; static.
        hard: whether thresholds are hard; static.
        mask: (T,) bool, False where a sample does not count for the magnitudes; None: all count.

    Raises:
        ValueError: as `transform` and `magnitude`.
    """
    whole, before = padded(x)
    within = slice(before, before + np.shape(x)[0])
    parts = [jnp.asarray(share, whole.dtype) for share in shares]
    details = transform(whole, WAVELET, len(parts))
    kept = tuple(
        threshold(d, share * magnitude(d[within], relative_to, mask)[None], hard=hard)
        for d, share in zip(details.details, parts, strict=True)
    )
    return inverse(Decomposition(jnp.zeros_like(details.approximation), kept), WAVELET)[within]
