"""Figures of a tuning: the loss of each step, and how precisely the data determine the parameters."""

import math
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import PyTree

from jgait.plot.style import DASHED, ESTIMATE, RED, REFERENCE, Figure, Style, blank, single

if TYPE_CHECKING:
    from matplotlib.axis import Axis

    from jgait.tune.fit import Fit
    from jgait.tune.identifiability import Identifiability
    from jgait.tune.profile import Profile


def _plain(axis: "Axis") -> None:
    """Label a logarithmic axis with numbers; powers of ten would need formulas, which `style.save` does not draw."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_data_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 1e3 * low else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def correlation(identifiability: "Identifiability", *, title: str = "") -> Figure:
    """Correlation of the errors of the parameters, dark near ±1; those that the data do not determine have a star."""
    values = identifiability.correlation
    size = len(values)
    side = 2.6 + (0.62 if size < 14 else 0.32) * size
    figure, axis = single(side + 0.8, side)
    shown = axis.imshow(np.abs(values), cmap="Greys", vmin=0.0, vmax=1.0)
    each = zip(identifiability.names, identifiability.determined, strict=True)
    names = [name if good else f"{name} *" for name, good in each]
    axis.set_xticks(range(size), names, rotation=45, ha="right", rotation_mode="anchor")
    axis.set_yticks(range(size), names)
    axis.set_xticks(np.arange(size - 1) + 0.5, minor=True)
    axis.set_yticks(np.arange(size - 1) + 0.5, minor=True)
    axis.grid(which="minor", color="0.8", linewidth=0.6)
    axis.tick_params(which="both", length=0)
    for i, j in np.ndindex(size, size) if size < 14 else ():
        value = values[i, j]
        text = "1" if i == j else "0" if abs(value) < 0.005 else f"{value:+.2f}".replace("-", "−")
        axis.text(j, i, text, ha="center", va="center", fontsize=8, color="white" if abs(value) > 0.55 else "black")
    bar = figure.colorbar(shown, ax=axis, shrink=0.8, pad=0.02)
    bar.set_label("|correlation| in free coordinates")
    if not identifiability.determined.all():
        axis.set_xlabel("* not determined by these data", fontsize=9)
    axis.set_title(title)
    return figure


def profile(profile: "Profile", *, title: str = "") -> Figure:
    """Increase of the loss with one parameter fixed at other values than the best, and ends of the 95 % interval."""
    figure, axis = single(6.0, 3.8)
    need = NormalDist().inv_cdf(0.975) ** 2 / 2.0
    finite = np.isfinite(profile.rises)
    rises = profile.rises[finite]
    axis.plot(*profile.curve(), **ESTIMATE)
    axis.plot(profile.values[finite], rises, "o", color=RED, markersize=4.5)
    axis.axhline(need, label=f"95 %: {need:.3g} nat", **REFERENCE)
    low, high = profile.interval(0.95)
    for end, words in ((low, "from"), (high, "to")):
        if end is not None:
            axis.plot([end, end], [0.0, need], label=f"{words} {end:.4g}", color="0.35", linewidth=1.0,
                      linestyle=":" if words == "from" else "-.")  # fmt: skip
    if low is None and high is None:
        axis.text(0.5, 0.5, "not determined by these data", transform=axis.transAxes, ha="center", fontsize=10)
    ratio = profile.values[-1] / profile.values[0] if profile.values[0] > 0.0 else 1.0
    if profile.transform.low == 0.0 and math.isinf(profile.transform.high) and ratio > 8.0:
        axis.set_xscale("log")
        _plain(axis.xaxis)
    axis.set_ylim(-0.06 * need, 1.05 * min(max(float(rises.max()), 1.35 * need), 5.0 * need))
    axis.set_xlabel(profile.name)
    axis.set_ylabel("loss above its minimum [nat]")
    axis.grid(alpha=0.3, which="both")
    axis.legend(loc="upper center" if low is not None and high is not None else "best", fontsize=8, framealpha=0.9)
    axis.set_title(title)
    return figure


def training(fit: "Fit[PyTree]", *, title: str = "") -> Figure:
    """Loss and gradient of each step, and the best step; crosses are undone steps (loss or gradient not finite)."""
    figure, axes = blank(2, 1, 6.4, 5.2, sharex=True)
    steps = np.arange(len(fit.losses))
    rejected = ~np.asarray(fit.accepted, bool)
    validation = np.asarray(fit.validation, float)
    norms = np.asarray(fit.gradient_norms, float)
    norms = np.where(norms > 0.0, norms, np.nan)  # zeros cannot be drawn on a logarithmic axis
    for axis, values, name in ((axes[0, 0], fit.losses, "loss"), (axes[1, 0], norms, "gradient norm")):
        axis.plot(steps, values, label=name, **ESTIMATE)
        if rejected.any():
            cross: Style = {"markersize": 6.0, "markeredgewidth": 1.4, "label": f"taken back ({rejected.sum()})"}
            axis.plot(steps[rejected], np.asarray(values)[rejected], "kx", **cross)
        axis.grid(alpha=0.3)
    looked = np.isfinite(validation)
    # The validation loss is computed after each step. Without validation items it equals the loss and is not drawn.
    if looked.any() and not np.array_equal(validation[:-1], np.asarray(fit.losses, float)[1:]):
        dots: Style = {"linestyle": DASHED, "linewidth": 1.0, "markersize": 3.5, "label": "validation"}
        axes[0, 0].plot(steps[looked] + 1, validation[looked], "ko", **dots)
    judged = np.append(fit.losses[0], validation) if looked.any() else np.append(fit.losses, fit.best_loss)
    best = int(np.nanargmin(np.abs(judged - fit.best_loss)))
    diamond: Style = {"markeredgecolor": "black", "markeredgewidth": 1.6, "markersize": 8.0, "zorder": 5}
    axes[0, 0].plot([best], [fit.best_loss], "Dw", label=f"best: step {best}", **diamond)
    axes[0, 0].set_ylabel("loss")
    axes[1, 0].set_ylabel("gradient norm\nin free coordinates")
    if np.nanmax(norms, initial=0.0) > 8.0 * np.nanmin(norms, initial=np.inf):
        axes[1, 0].set_yscale("log")
        _plain(axes[1, 0].yaxis)
    axes[1, 0].set_xlabel("step")
    axes[0, 0].legend(loc="upper right", fontsize=8, framealpha=0.9)
    figure.suptitle(title)
    return figure
