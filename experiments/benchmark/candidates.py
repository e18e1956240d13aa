"""What the filter benchmark compares: jgait, a textbook filter, other JAX libraries, and two that JAX does not compile.

A `Candidate` filters one recording; the benchmark maps it over many and differentiates it. The others are functions
that return what they compute. All start from the same belief one interval before the first sample.
"""

import ctypes
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from experiments.benchmark import leg
from experiments.benchmark.leg import DT, Rates, observation_vector, start_vector, transition_vector, variances
from jgait import filtering


class Candidate(NamedTuple):
    """A filter that JAX compiles, for one recording.

    Attributes:
        name: short, as in the metrics.
        filtered: (log noise (6,), rates) → filtered means, log-likelihood.
        smoothed: (log noise, rates) → smoothed means.
        arranged: rates (T, ..., 2) → what the two above take, time in front.
        path: means → x, y.
        stacked: means → (T, ..., 8).
    """

    name: str
    filtered: Callable[[Any, Any], tuple[Any, Any]]
    smoothed: Callable[[Any, Any], Any]
    arranged: Callable[[Any], Any] = lambda rates: rates
    path: Callable[[Any], tuple[Any, Any]] = lambda means: (means[..., 0], means[..., 1])
    stacked: Callable[[Any], Any] = lambda means: means


# --- jgait ---


def jgait_candidate(name: str, **execution: Any) -> Candidate:
    """The library's filter, by one of its executions."""

    def filtered(theta: Any, rates: Rates) -> tuple[Any, Any]:
        kept = ("mean", "log_likelihood")
        found = filtering.kalman_filter(leg.MODEL, leg.noise_of(theta), rates, dt=DT, keep=kept, **execution)
        return found.mean, found.log_likelihood.sum()

    def smoothed(theta: Any, rates: Rates) -> Any:
        found = filtering.kalman_smoother(
            leg.MODEL, leg.noise_of(theta), rates, dt=DT, keep=(), covariance=False, **execution
        )
        return found.mean

    return Candidate(
        name, filtered, smoothed, lambda rates: Rates(rates[..., 0], rates[..., 1]),
        lambda means: (means.x, means.y), lambda means: jnp.stack(means, -1),
    )  # fmt: skip


# --- the textbook ---


def textbook() -> Candidate:
    """Vectors and matrices as the books write them: Jacobians by jacfwd, products by @, one solve a step."""

    def predicted(mean: Any, cov: Any, Q: Any) -> tuple[Any, Any, Any]:
        F = jax.jacfwd(transition_vector)(mean)
        return transition_vector(mean), F @ cov @ F.T + Q, F

    def scanned(theta: Any, rates: Any) -> tuple[Any, Any]:
        q, r = variances(theta)

        def step(carry: tuple[Any, Any], measured: Any) -> tuple[Any, Any]:
            mean, cov, _ = predicted(*carry, jnp.diag(q))
            H = jax.jacfwd(observation_vector)(mean)
            error = measured - observation_vector(mean)
            S = H @ cov @ H.T + jnp.diag(r)
            K = jnp.linalg.solve(S, H @ cov).T
            mean, cov = mean + K @ error, cov - K @ H @ cov
            cov = (cov + cov.T) / 2
            nis, size = error @ jnp.linalg.solve(S, error), jnp.linalg.slogdet(2 * jnp.pi * S)[1]
            return (mean, cov), (mean, cov, -(nis + size) / 2)

        return lax.scan(step, start_vector(rates.dtype), rates)[1]

    def filtered(theta: Any, rates: Any) -> tuple[Any, Any]:
        means, _, terms = scanned(theta, rates)
        return means, terms.sum()

    def smoothed(theta: Any, rates: Any) -> Any:
        means, covs, _ = scanned(theta, rates)
        Q = jnp.diag(variances(theta)[0])

        def step(following: tuple[Any, Any], before: tuple[Any, Any]) -> tuple[Any, Any]:
            mean, cov = before
            ahead, spread, F = predicted(mean, cov, Q)
            G = jnp.linalg.solve(spread, F @ cov).T
            mean, cov = mean + G @ (following[0] - ahead), cov + G @ (following[1] - spread) @ G.T
            return (mean, cov), mean

        last = (means[-1], covs[-1])
        return jnp.concatenate([lax.scan(step, last, (means[:-1], covs[:-1]), reverse=True)[1], means[-1:]])

    return Candidate("textbook", filtered, smoothed)


# --- other libraries ---


def dynamax() -> Candidate:
    from dynamax import nonlinear_gaussian_ssm as library

    def parameters(theta: Any, dtype: Any) -> Any:
        q, r = variances(theta)
        mean, cov = start_vector(dtype)
        F = jax.jacfwd(transition_vector)(mean)
        # Its initial belief is that at the first sample.
        mean, cov = transition_vector(mean), F @ cov @ F.T + jnp.diag(q)
        return library.ParamsNLGSSM(mean, cov, transition_vector, jnp.diag(q), observation_vector, jnp.diag(r))

    def filtered(theta: Any, rates: Any) -> tuple[Any, Any]:
        fields = ["filtered_means"]
        found = library.extended_kalman_filter(parameters(theta, rates.dtype), rates, output_fields=fields)
        return found.filtered_means, found.marginal_loglik

    def smoothed(theta: Any, rates: Any) -> Any:
        return library.extended_kalman_smoother(parameters(theta, rates.dtype), rates).smoothed_means

    return Candidate("dynamax", filtered, smoothed)


def kalman_py() -> Candidate:
    # Its public class converts to NumPy, which neither vmap nor grad can pass; these are what it calls.
    from kalman_py.backends.jax_backend import _ekf_filter, _rts_smoother

    def transition(state: Any, dt: Any) -> Any:
        return transition_vector(state)

    def run(theta: Any, rates: Any) -> Any:
        q, r = variances(theta)
        return _ekf_filter(
            jnp.diag(q), jnp.diag(r), *start_vector(rates.dtype), rates, jnp.full(len(rates), DT, rates.dtype),
            f=transition, h=observation_vector, jac_f=None, jac_h=None, residual=None, square_root=False,
        )  # fmt: skip

    def filtered(theta: Any, rates: Any) -> tuple[Any, Any]:
        found = run(theta, rates)
        return found.means, found.log_likelihood

    def smoothed(theta: Any, rates: Any) -> Any:
        found = run(theta, rates)
        return _rts_smoother(found.transition_jacobians[1:] @ found.covs[:-1], found).means

    return Candidate("kalman_py", filtered, smoothed)


def cuthbert() -> Candidate:
    from cuthbert import filter as run_filter
    from cuthbert import smoother as run_smoother
    from cuthbert.gaussian import moments

    def run(theta: Any, rates: Any) -> tuple[Any, Any]:
        q, r = (jnp.diag(jnp.sqrt(v)) for v in variances(theta))
        mean, cov = start_vector(rates.dtype)

        def dynamics(state: Any, measured: Any) -> tuple[Any, Any]:
            return lambda x: (transition_vector(x), q), state.mean

        def sensors(state: Any, measured: Any) -> tuple[Any, Any, Any]:
            return lambda x: (observation_vector(x), r), state.mean, measured

        chosen = moments.build_filter(mean, jnp.sqrt(cov), dynamics, sensors, associative=False)
        return run_filter(chosen, rates, chosen.init_prepare()), dynamics

    def filtered(theta: Any, rates: Any) -> tuple[Any, Any]:
        states, _ = run(theta, rates)
        return states.mean[1:], states.log_normalizing_constant[-1]

    def smoothed(theta: Any, rates: Any) -> Any:
        states, dynamics = run(theta, rates)
        return run_smoother(moments.build_smoother(dynamics), states).mean[1:]

    return Candidate("cuthbert", filtered, smoothed)


def candidates() -> tuple[list[Candidate], list[str]]:
    """Those that can be had here, and a line on each that cannot."""
    found, absent = [jgait_candidate("core", execution="core"), jgait_candidate("fast", execution="fast")], []
    found.append(textbook())
    for make in (dynamax, kalman_py, cuthbert):
        try:
            found.append(make())
        except ImportError as error:
            absent.append(f"{make.__name__} is absent: {error}")
    return found, absent


# --- not JAX ---


def diagonals() -> tuple[Any, Any]:
    """Diagonals of Q (8,) and R (2,) in NumPy."""
    noise = np.exp(leg.LOG_NOISE.astype(float))
    return noise[[0, 0, 1, 2, 1, 2, 3, 3]], noise[4:]


def filterpy(samples: int) -> tuple[int, Callable[[Any], Any]]:
    """How many samples of a recording it runs, and (T, 2) float64 → (T, 8); raises ImportError."""
    from filterpy.kalman import ExtendedKalmanFilter

    q, r = diagonals()
    H = np.array([[0, 0, 0, 1, 0, 0, 1, 0], [0, 0, 0, 1, 0, 1, 0, 1]], float)

    class Leg(ExtendedKalmanFilter):
        def predict_x(self, u: Any = 0) -> None:
            x, y, thigh, w, knee, v, *bias = self.x
            s2, c2 = leg.SHANK * np.sin(thigh + knee), leg.SHANK * np.cos(thigh + knee)
            s, c = leg.THIGH * np.sin(thigh) + s2, leg.THIGH * np.cos(thigh) + c2
            vx, vy = -s * w - s2 * v, c * w + c2 * v
            self.F = np.eye(8)
            self.F[0, 2:6] = -DT * vy, -DT * s, -DT * c2 * (w + v), -DT * s2
            self.F[1, 2:6] = DT * vx, DT * c, -DT * s2 * (w + v), DT * c2
            self.F[2, 3] = self.F[4, 5] = DT
            self.x = np.array([x + DT * vx, y + DT * vy, thigh + DT * w, w, knee + DT * v, v, *bias])

    def run(rates: Any) -> Any:
        ekf = Leg(8, 2)
        ekf.x, ekf.P, ekf.Q, ekf.R = np.array(leg.START), np.diag(leg.SPREAD), np.diag(q), np.diag(r)
        means = np.empty((len(rates), 8))
        for k, measured in enumerate(rates):
            ekf.predict()
            ekf.update(measured, lambda x: H, lambda x: H @ x)
            means[k] = ekf.x
        return means

    return min(samples, 300), run


class Limit:
    """The C reference, compiled for this machine into a temporary folder."""

    def __init__(self) -> None:
        """Compile it; raises RuntimeError with the reason where that cannot be done."""
        compiler = shutil.which("gcc")
        if compiler is None:
            raise RuntimeError("c is absent: there is no gcc")
        source = Path(__file__).with_name("limit.c")
        flags = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC"]
        if platform.machine() in ("x86_64", "AMD64"):
            flags.append("-mprefer-vector-width=512")
        self.libraries = {}
        with tempfile.TemporaryDirectory() as folder:
            for kind, dtype, width in (("float", np.float32, 16), ("double", np.float64, 8)):
                for lanes in (1, width):
                    target = Path(folder) / f"limit_{kind}_{lanes}.so"
                    what = [f"-DREAL={kind}", f"-DLANES={lanes}", str(source), "-o", str(target)]
                    done = None
                    for libraries in (["-lmvec", "-lm"], ["-lm"]):
                        done = subprocess.run([compiler, *flags, *what, *libraries], capture_output=True, text=True)
                        if done.returncode == 0:
                            break
                    else:
                        raise RuntimeError(f"c is absent: gcc says {done.stderr.strip()[:300]}")
                    self.libraries[np.dtype(dtype), lanes > 1] = ctypes.CDLL(str(target)), lanes

    def prepare(self, rates: Any, dtype: Any) -> tuple[Callable[[], Any], Callable[[], tuple[Any, Any]]]:
        """For rates (B, T, 2): a function that runs, and one that gives means (T, B, 8) and log-likelihoods (B,).

        Its arrays lie in tiles of its lanes, which suits the cache best: this stands for what the machine can do.
        """
        dtype = np.dtype(dtype)
        count, samples, _ = rates.shape
        library, lanes = self.libraries[dtype, count > 1]
        tiles = -(-count // lanes)
        padded = np.concatenate([rates, np.repeat(rates[-1:], tiles * lanes - count, 0)]).astype(dtype)
        tiled = np.ascontiguousarray(padded.reshape(tiles, lanes, samples, 2).transpose(0, 2, 3, 1))
        means, total = np.zeros((tiles, samples, 8, lanes), dtype), np.zeros(tiles * lanes, dtype)
        fixed = [np.array(v, dtype) for v in (leg.START, leg.SPREAD, *diagonals())]
        real = ctypes.c_float if dtype == np.float32 else ctypes.c_double
        # The arrays live as long as `run` and `result`, which hold them.
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in (tiled, means, total, *fixed)]
        arguments = (
            *pointers[:3], ctypes.c_long(tiles), ctypes.c_long(samples),
            real(DT), real(leg.THIGH), real(leg.SHANK), *pointers[3:],
        )  # fmt: skip

        def run(held: Any = (tiled, fixed)) -> Any:
            library.leg_filter(*arguments)
            return means

        def result() -> tuple[Any, Any]:
            untiled = means.transpose(1, 0, 3, 2).reshape(samples, tiles * lanes, 8)
            return untiled[:, :count], total[:count]

        return run, result
