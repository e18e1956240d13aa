#!/usr/bin/env bash
# cuthbert 0.1.1 beside dynamax 1.0.3 (Kalman filters in JAX).
# Expected: the same random walk, first belief N(0, 1) and three samples give the same estimates,
#   one for each sample, and the same log-likelihood.
# Seen: cuthbert predicts before the first sample and returns 4 states, the first one the
#   belief before any data; dynamax updates with the first sample at once and returns 3.
#   The estimates at the first sample are 0.667 and 0.500, the log-likelihoods -5.208 and -5.232.
# For gait: events read from a cuthbert state are late by one sample unless row 0 is
#   dropped, and likelihoods of the two libraries cannot be compared as they are.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    jax==0.12.0 jaxlib==0.12.0 cuthbert==0.1.1 cuthbertlib==0.1.1 dynamax==1.0.3 \
    tfp-nightly==0.26.0.dev20261027 numpy==2.5.5 scipy==1.18.1

"$work/venv/bin/python" - <<'EOF'
import jax

jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import numpy as np
from cuthbert import filter as run_filter
from cuthbert.gaussian import kalman
from dynamax.linear_gaussian_ssm import lgssm_filter
from dynamax.linear_gaussian_ssm.inference import make_lgssm_params

one, zero = jnp.eye(1), jnp.zeros(1)
samples = jnp.array([[1.0], [2.0], [3.0]])

model = kalman.build_filter(
    zero, one, lambda i: (one, zero, one), lambda i: (one, zero, one, samples[i])
)
a = run_filter(model, jnp.arange(3), model.init_prepare())
b = lgssm_filter(make_lgssm_params(zero, one, one, one, one, one), samples)

mean_a, mean_b = np.ravel(a.mean), np.ravel(b.filtered_means)
like_a, like_b = float(a.log_normalizing_constant[-1]), float(b.marginal_loglik)
print("cuthbert:", len(mean_a), "states for 3 samples:", mean_a.round(3), "log-likelihood", round(like_a, 3))
print("dynamax: ", len(mean_b), "states for 3 samples:", mean_b.round(3), "log-likelihood", round(like_b, 3))


def by_hand(predict_first):
    """Textbook recursion; the mean after each sample and the log-likelihood."""
    m, p, means, total = 0.0, 1.0, [], 0.0
    for i, value in enumerate(np.ravel(samples)):
        p += 1.0 if i or predict_first else 0.0
        s = p + 1.0
        total -= 0.5 * (np.log(2 * np.pi * s) + (value - m) ** 2 / s)
        m, p = m + p / s * (value - m), p / s
        means.append(m)
    return np.array(means), total


for (means, total), got, like in ((by_hand(True), mean_a[1:], like_a), (by_hand(False), mean_b, like_b)):
    assert np.allclose(means, got, atol=1e-6) and abs(total - like) < 1e-6
assert len(mean_a) == 4 and mean_a[0] == 0 and len(mean_b) == 3
EOF
