"""Which way the surface looks that a ray has met, by its kind: faces, rounds, leaves, the ground.

Each step is a program of its own: fused into one, XLA on a CPU works out what several components need anew for each,
and without vector instructions where it joins them.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from jaxsim.data.synthetic.fields import everywhere, smooth_noise3, unit_vector, vector
from jaxsim.data.synthetic.solids import CROWNS, FACES, GROUND, LEAF_M, POLYHEDRA, ROUNDS, Solids
from jaxsim.data.synthetic.street import Street, ground_normal
from jaxsim.frame import Array


def normals(
    solids: Solids,
    street: Street,
    code: Int[Array, "h w"],
    *,
    solid: Int[Array, "h w"],
    at: Float[Array, "3 h w"],
    kerb: Bool[Array, "h w"],
) -> Float[Array, "3 h w"]:
    """Unit normals, outward, by the codes and solids of `raycast`, the places, and where these are a kerb's face."""
    smooth = _round_normal(_conics_at(solids, jnp.clip(solid - POLYHEDRA, 0, ROUNDS + CROWNS - 1)), at)
    ground = ground_normal(street, at[0], at[1], face=kerb)
    return _by_kind(_face_normal(solids, code), smooth, _leafy(smooth, _leaf_turn(at)), ground=ground, solid=solid)


@jax.jit
def _face_normal(solids: Solids, code: Int[Array, "h w"]) -> Float[Array, "3 h w"]:
    # The code of a hit with a polyhedron is the number of its plane among all of them.
    planes = solids.planes[:, :, :3].reshape(-1, 3).T
    return planes[:, jnp.where((code >= 0) & (code < POLYHEDRA * FACES), code, 0)]


@jax.jit
def _leafy(normal: Float[Array, "3 h w"], turn: Float[Array, "3 h w"]) -> Float[Array, "3 h w"]:
    return unit_vector(normal + 2.2 * turn)


@jax.jit
def _by_kind(
    face: Float[Array, "3 h w"],
    smooth: Float[Array, "3 h w"],
    leafy: Float[Array, "3 h w"],
    *,
    ground: Float[Array, "3 h w"],
    solid: Int[Array, "h w"],
) -> Float[Array, "3 h w"]:
    normal = jnp.where((solid >= POLYHEDRA + ROUNDS)[None], leafy, smooth)
    normal = jnp.where((solid < POLYHEDRA)[None], face, normal)
    return jnp.where((solid >= GROUND)[None], ground, normal)


@jax.jit
def _conics_at(solids: Solids, conic: Int[Array, "h w"]) -> Float[Array, "13 h w"]:
    """Each ray's quadric, row by row, and whether it is a ball."""
    ball = jnp.concatenate([solids.roundness, jnp.ones_like(solids.path_m)])
    return jnp.concatenate([solids.conics.reshape(-1, 12), ball[:, None]], axis=1).T[:, conic]


@jax.jit
def _round_normal(conic: Float[Array, "13 h w"], at: Float[Array, "3 h w"]) -> Float[Array, "3 h w"]:
    *rows, ball = conic
    local = [sum(rows[4 * i + j] * at[j] for j in range(3)) + rows[4 * i + 3] for i in range(3)]
    # The quadric's gradient in its own frame is the place itself, without z on a cylinder; A^T takes it to `world`.
    cap = (ball < 0.5) & (jnp.abs(local[2]) > 0.999)
    weight = [jnp.where(cap, 0.0, local[0]), jnp.where(cap, 0.0, local[1]), jnp.where(cap, local[2], ball * local[2])]
    return unit_vector(vector(*(sum(rows[4 * i + j] * weight[i] for i in range(3)) for j in range(3))))


@jax.jit
def _leaf_turn(at: Float[Array, "3 h w"]) -> Float[Array, "3 h w"]:
    """What to add to a crown's normal: leaves point outwards on the whole, each clump its own way."""
    x, y, z = at / LEAF_M
    shift = everywhere(jnp.array([17.0, 31.0, 47.0], jnp.float32), x)
    return smooth_noise3(x[None] + shift, y[None], z[None]) - 0.5
