"""Which way the surface looks that a ray has met, by its kind: faces, rounds, leaves, the ground.

Each kind is worked out in those blocks of rays alone that hold some of it.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from jaxsim.data.synthetic.fields import Triple, each, in_blocks, smooth_noise3, unit_vector, when
from jaxsim.data.synthetic.solids import CROWNS, FACES, GROUND, LEAF_M, POLYHEDRA, ROUNDS, Solids
from jaxsim.data.synthetic.street import Street, ground_normal
from jaxsim.frame import Array


@jax.jit
def normals(
    solids: Solids,
    street: Street,
    code: Int[Array, "*r"],
    *,
    solid: Int[Array, "*r"],
    at: Triple,
    kerb: Bool[Array, "*r"],
) -> Triple:
    """Unit normals, outward, by the codes and solids of `raycast`, the places, and where these are a kerb's face."""

    def by_kind(*, code: Int[Array, "*r"], solid: Int[Array, "*r"], at: Triple, kerb: Bool[Array, "*r"]) -> Triple:
        # The code of a hit with a polyhedron is the number of its plane among all of them.
        plane = jnp.where((code >= 0) & (code < POLYHEDRA * FACES), code, 0)
        face = each(lambda i: solids.planes[:, :, i].reshape(-1)[plane])
        curved = (solid >= POLYHEDRA) & (solid < GROUND)
        smooth = when(curved, partial(_round_normal, solids), solid, at)
        leafy = when(curved & (solid >= POLYHEDRA + ROUNDS), _leafy, smooth, at)
        ground = when(kerb, lambda at, kerb: ground_normal(street, at[0], at[1], face=kerb), at, kerb)

        def component(i: int) -> Float[Array, "*r"]:
            normal = jnp.where(solid >= POLYHEDRA + ROUNDS, leafy[i], smooth[i])
            flat = jnp.where(kerb, ground[i], 1.0 if i == 2 else 0.0)
            return jnp.where(solid >= GROUND, flat, jnp.where(solid < POLYHEDRA, face[i], normal))

        return each(component)

    return in_blocks(lambda block: by_kind(**block), {"code": code, "solid": solid, "at": at, "kerb": kerb})


def _round_normal(solids: Solids, solid: Int[Array, "*r"], at: Triple) -> Triple:
    # Each ray's quadric, row by row, and whether it is a ball.
    number = jnp.clip(solid - POLYHEDRA, 0, ROUNDS + CROWNS - 1)
    balls = jnp.concatenate([solids.roundness, jnp.ones_like(solids.path_m)])
    rows = [column[number] for column in solids.conics.reshape(-1, 12).T]
    ball = balls[number]
    local = [sum(rows[4 * i + j] * at[j] for j in range(3)) + rows[4 * i + 3] for i in range(3)]
    # The quadric's gradient in its own frame is the place itself, without z on a cylinder; A^T takes it to `world`.
    cap = (ball < 0.5) & (jnp.abs(local[2]) > 0.999)
    weight = [jnp.where(cap, 0.0, local[0]), jnp.where(cap, 0.0, local[1]), jnp.where(cap, local[2], ball * local[2])]
    return unit_vector(each(lambda j: sum(rows[4 * i + j] * weight[i] for i in range(3))))


def _leafy(normal: Triple, at: Triple) -> Triple:
    """A crown's normal: leaves point outwards on the whole, each clump its own way."""
    x, y, z = each(lambda i: at[i] / LEAF_M)
    return unit_vector(each(lambda i: normal[i] + 2.2 * (smooth_noise3(x + (17.0, 31.0, 47.0)[i], y, z) - 0.5)))
