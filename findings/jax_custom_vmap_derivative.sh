#!/usr/bin/env bash
# jax 0.12.0 (jax.custom_batching.custom_vmap).
# Expected: the rule of a custom_vmap function is called when one of its arguments is batched.
#   A rule that hands in_batched on to jax.vmap therefore always has an axis to map.
# Seen: the forward derivative taken under vmap, with batched values and a tangent
#   that is not batched, calls the rule with nothing batched, and jax.vmap raises ValueError. With the tangent
#   batched too, or the derivative taken outside the vmap, the same function works.
# For gait: a Kalman step with its own batching rule, differentiated for each person with
#   respect to one shared direction, stops there.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile \
    jax==0.12.0 jaxlib==0.12.0 numpy==2.5.5 scipy==1.18.1

"$work/venv/bin/python" - <<'EOF'
import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap

calls = []


@custom_vmap
def product(x, y):
    return x * y


@product.def_vmap
def rule(size, in_batched, x, y):
    calls.append(tuple(in_batched))
    axes = tuple(0 if batched else None for batched in in_batched)
    return jax.vmap(jnp.multiply, in_axes=axes)(x, y), True


def slope(x, y, dx, dy):
    return jax.jvp(product, (x, y), (dx, dy))[1]


xs, ones = jnp.array([1.0, 2.0, 3.0]), jnp.ones(3)
ys = 2 * xs

plain = jax.vmap(product)(xs, ys)
both = jax.vmap(slope)(xs, ys, ones, ones)
outside = jax.jvp(jax.vmap(product), (xs, ys), (ones, ones))[1]
print("values under vmap:                         ", plain)
print("derivative under vmap, tangents batched:   ", both)
print("derivative of the vmap:                    ", outside)
assert (both == xs + ys).all() and (outside == xs + ys).all()

calls.clear()
try:
    print(jax.vmap(slope, in_axes=(0, 0, None, None))(xs, ys, 1.0, 1.0))
except ValueError as error:
    print("derivative under vmap, tangents not batched: ValueError:", str(error).splitlines()[0][:90])
    print("the rule was called with in_batched =", calls[-1])
    assert calls[-1] == (False, False)
else:
    raise SystemExit("no error any more")
EOF
