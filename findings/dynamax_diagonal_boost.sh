#!/usr/bin/env bash
# dynamax 1.0.3 (lgssm_filter), in double precision.
# Expected: the gain of a Kalman filter depends on the ratio of the variances only; with equal
#   variances of belief and sample the first estimate lies halfway, in any unit.
# Seen: 1e-9 is added to the diagonal before each solve. With variances of 1 the estimate is
#   0.5, with 1e-9 it is 0.333, with 1e-12 it is 0.001: the sample is all but ignored.
# For gait: metres and seconds lead to such numbers (a variance of 1e-10 is 0.01 mm for
#   markers or stance at zero velocity); the same data in millimetres gives another result.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    jax==0.12.0 jaxlib==0.12.0 dynamax==1.0.3 tfp-nightly==0.26.0.dev20261027 numpy==2.5.5 scipy==1.18.1

"$work/venv/bin/python" - <<'EOF'
import jax

jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
from dynamax.linear_gaussian_ssm import lgssm_filter
from dynamax.linear_gaussian_ssm.inference import make_lgssm_params

one, zero = jnp.eye(1), jnp.zeros(1)
for variance in (1.0, 1e-6, 1e-9, 1e-10, 1e-12):
    model = make_lgssm_params(zero, variance * one, one, zero[:, None], one, variance * one)
    seen = float(lgssm_filter(model, jnp.ones((1, 1))).filtered_means[0, 0])
    with_boost = variance / (2 * variance + 1e-9)
    print(f"variances {variance:.0e}: estimate {seen:.6f}, textbook 0.5, with 1e-9 added {with_boost:.6f}")
    assert abs(seen - with_boost) < 1e-6, "the addition to the diagonal has changed"
EOF
