"""Normals of a rendered street against what was hit: planes, slopes of quadrics by differences, the ground."""

from functools import cache

import numpy as np

from jaxsim.data.synthetic import SyntheticWorld, render
from jaxsim.data.synthetic.raycast import cast_solids, nearest_hits
from jaxsim.data.synthetic.solids import CROWNS, FACES, GROUND, POLYHEDRA, ROUNDS
from jaxsim.data.synthetic.tiles import polar_mask, solids_by_tile


@cache
def met():
    """A sweep: solids, hits and codes as NumPy arrays."""
    world = SyntheticWorld(seed=5, columns=512)
    moment = world._moment(2)
    corners = (moment.corners - moment.velo_pose[:3, 3]) @ moment.velo_pose[:3, :3]
    listed = solids_by_tile(polar_mask(corners, world.grid, render.LIDAR_TILE), moment.drive.parts.counts)
    origin, direction = render._beams(world.grid, moment.velo_pose.astype(np.float32))
    rays = {"candidates": listed, "tile": render.LIDAR_TILE}
    scene = moment.scene
    hit = nearest_hits(scene.solids, scene.street, origin=origin, direction=direction, **rays)
    _, code = cast_solids(scene.solids, origin, direction, **rays)
    return scene.solids, {name: np.asarray(getattr(hit, name)) for name in ("solid", "normal", "at", "kerb")}, code


def test_normals_are_unit_vectors():
    _, hit, _ = met()
    # XLA's older emitters, with which tests compile, leave two rays of 32 768 1.2e-5 off; the newer ones none 2e-7.
    np.testing.assert_allclose(np.linalg.norm(hit["normal"], axis=0), 1, atol=2.5e-5)


def test_a_face_has_the_normal_of_its_plane_and_lies_in_it():
    solids, hit, code = met()
    flat = hit["solid"] < POLYHEDRA
    plane = np.asarray(solids.planes).reshape(-1, 4)[np.asarray(code)[flat]]
    normal, at = hit["normal"][:, flat].T, hit["at"][:, flat].T
    assert flat.sum() > 1000
    np.testing.assert_array_equal(np.asarray(code)[flat] // FACES, hit["solid"][flat])
    np.testing.assert_allclose(normal, plane[:, :3], atol=1e-6)
    np.testing.assert_allclose((normal * at).sum(-1), plane[:, 3], atol=2e-3)


def test_a_round_looks_where_its_quadric_grows():
    solids, hit, _ = met()
    round_ = (hit["solid"] >= POLYHEDRA) & (hit["solid"] < POLYHEDRA + ROUNDS)
    number = hit["solid"][round_] - POLYHEDRA
    conic = np.asarray(solids.conics, np.float64)[number]
    ball = np.asarray(solids.roundness, np.float64)[number]
    at, normal = hit["at"][:, round_].T.astype(np.float64), hit["normal"][:, round_].T

    def inside(place):
        """The quadric's function, and how far along its axis."""
        x, y, z = np.moveaxis(np.einsum("nij,nj->ni", conic[:, :, :3], place) + conic[:, :, 3], -1, 0)
        return x**2 + y**2 + ball * z**2, z

    step = 1e-4 * np.eye(3)
    slope = np.stack([inside(at + e)[0] - inside(at - e)[0] for e in step], -1)
    slope /= np.linalg.norm(slope, axis=-1, keepdims=True)
    # The caps of cylinders look along their axes.
    along = np.abs(inside(at)[1])
    wall = (ball > 0.5) | (along < 0.99)
    assert wall.sum() > 100
    np.testing.assert_allclose(normal[wall], slope[wall], atol=2e-3)


def test_leaves_look_outwards_on_the_whole_and_each_its_own_way():
    solids, hit, _ = met()
    crown = (hit["solid"] >= POLYHEDRA + ROUNDS) & (hit["solid"] < POLYHEDRA + ROUNDS + CROWNS)
    conic = np.asarray(solids.conics, np.float64)[hit["solid"][crown] - POLYHEDRA]
    at, normal = hit["at"][:, crown].T, hit["normal"][:, crown].T
    local = np.einsum("nij,nj->ni", conic[:, :, :3], at) + conic[:, :, 3]
    outward = np.einsum("nij,ni->nj", conic[:, :, :3], local)
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    cosine = (outward * normal).sum(-1)
    assert crown.sum() > 200
    assert cosine.mean() > 0.5
    assert (cosine < 0.95).mean() > 0.3


def test_the_ground_looks_up_but_for_its_kerbs():
    _, hit, _ = met()
    ground = (hit["solid"] == GROUND) & ~hit["kerb"]
    np.testing.assert_array_equal(hit["normal"][:, ground].T, np.tile([0, 0, 1], (ground.sum(), 1)))
    kerb = hit["kerb"]
    assert kerb.sum() > 10
    np.testing.assert_allclose(hit["normal"][2, kerb], 0, atol=1e-6)
