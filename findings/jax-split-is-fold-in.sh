#!/usr/bin/env bash
# JAX 0.10.2 (and 0.12.0.1), default settings (threefry2x32, jax_threefry_partitionable on): the i-th key of `jax.random.split(key, n)`
# is `jax.random.fold_in(key, i)`, for every n. A program that hands out one stream by `split` and another, meant to be
# independent, by `fold_in` with a small number gets the same numbers twice, in silence. With the older generator
# (jax_threefry_partitionable off) the two have nothing in common.
#
# Fails if that changes.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet "jax==0.10.2" "jaxlib==0.10.2"
"$work/venv/bin/python" - <<'PYTHON'
import jax
import numpy as np

key = jax.random.key(3)


def same() -> list[bool]:
    """Whether the keys of a split are those of fold_in with their numbers, for splits into 2, 3 and 5."""
    data = jax.random.key_data
    return [bool(np.array_equal(data(jax.random.split(key, n)[i]), data(jax.random.fold_in(key, i))))
            for n in (2, 3, 5) for i in range(n)]


new = same()
with jax.threefry_partitionable(False):
    old = same()
split, folded = (jax.random.normal(each, (3,)) for each in (jax.random.split(key)[1], jax.random.fold_in(key, 1)))
print("jax", jax.__version__)
print("split(key, n)[i] is fold_in(key, i):", all(new), "; with the older generator:", any(old))
print("normal numbers of both:", split, folded)
assert all(new) and not any(old) and np.array_equal(split, folded)
PYTHON
