"""Solids in the world are those of their models, moved and turned."""

import numpy as np
import pytest

from jaxsim.data.synthetic.solids import CAPACITY, Look, Model, Thing, gather_solids, in_world, poses_at

LOOK = Look(11, (0.5, 0.5, 0.5), 0.4)


def test_points_lie_in_a_placed_box_where_they_lie_in_its_model():
    model = Model()
    model.box((-1.0, -0.5, 0.0), (2.0, 0.5, 1.5), LOOK)
    things = [Thing(model, 10.0, -3.0, turn_rad=0.7, z_m=0.1, speed_mps=5.0)]
    [spot], [heading] = poses_at(things, 0.0, 2.0)
    np.testing.assert_allclose(spot, [20.0, -3.0, 0.1])
    solids, corners = in_world(gather_solids(things), spot[None], heading[None], instance=np.array([7]))
    inner = np.random.default_rng(0).uniform((-2, -1, -1), (3, 1, 2.5), (500, 3))
    turn = np.array([[np.cos(0.7), -np.sin(0.7), 0], [np.sin(0.7), np.cos(0.7), 0], [0, 0, 1]])
    world = inner @ turn.T + spot
    planes = solids.planes[0]
    within = (world @ planes[:, :3].T <= planes[:, 3] + 1e-6).all(axis=1)
    np.testing.assert_array_equal(within, ((inner >= (-1, -0.5, 0)) & (inner <= (2, 0.5, 1.5))).all(axis=1))
    assert within.any()
    np.testing.assert_allclose(
        np.sort(corners[0] @ turn - spot @ turn, axis=0)[[0, -1]], [(-1, -0.5, 0), (2, 0.5, 1.5)]
    )
    assert (solids.planes[1:] == 0).all()


def test_a_ball_is_the_unit_ball_seen_through_its_map():
    model = Model()
    model.ball((1.0, 2.0, 3.0), (0.5, 1.0, 2.0), LOOK)
    [conic] = gather_solids([Thing(model, 0.0, 0.0)]).conics
    on = np.array([[1.5, 2, 3], [1, 3, 3], [1, 2, 5]])
    np.testing.assert_allclose(np.linalg.norm(on @ conic[:, :3].T + conic[:, 3], axis=1), 1)


def test_more_solids_than_there_is_room_for_are_an_error():
    model = Model()
    for _ in range(CAPACITY[0] + 1):
        model.box((0, 0, 0), (1, 1, 1), LOOK)
    with pytest.raises(ValueError, match="a scene has room for"):
        gather_solids([Thing(model, 0.0, 0.0)])
