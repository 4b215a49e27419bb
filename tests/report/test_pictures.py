"""Pictures of rasters, clouds and frames."""

import cv2
import numpy as np
import pytest

from jaxsim.frame import Painted, Pair, PolarImage
from jaxsim.report.pictures import (
    NO_RETURN,
    beside,
    colour_classes,
    colour_scalar,
    draw_cloud,
    input_panels,
    intensity_panel,
    pair_picture,
    save_picture,
    save_pictures,
    simulated_picture,
    strip,
)


def test_cells_without_a_value_are_grey_and_the_others_follow_the_scale():
    value = np.array([[0.0, 1.0, 0.5]])
    rgb = colour_scalar(value, np.array([[True, True, False]]), low=0, high=1)
    assert rgb[0, 2].tolist() == NO_RETURN.tolist()
    assert rgb[0, 0].tolist() != rgb[0, 1].tolist()


def test_classes_have_cityscapes_colours():
    rgb = colour_classes(np.array([[7, 26]]), np.array([[True, True]]))
    assert rgb[0].tolist() == [[128, 64, 128], [0, 0, 142]]


def test_panels_share_a_width_and_pictures_a_height():
    panel = np.zeros((4, 8, 3), np.uint8)
    assert strip([("one", panel), ("two", panel)], width=80).shape == (2 * (26 + 40), 80, 3)
    assert beside([panel, panel[:2]]).shape == (4, 24, 3)
    # Of one row of very many columns a line is left.
    assert strip([("one", np.zeros((1, 5000, 3), np.uint8))], width=80).shape == (26 + 1, 80, 3)


def test_points_ahead_are_drawn_and_those_behind_are_not():
    empty = draw_cloud(np.zeros((0, 4), np.float32))
    ahead = draw_cloud(np.float32([[20, 0, -1, 0.5]]))
    behind = draw_cloud(np.float32([[-60, 0, -1, 0.5]]))
    assert (ahead != empty).any()
    assert (behind == empty).all()


def test_a_picture_is_read_back_as_it_was_and_an_unknown_format_is_refused(tmp_path):
    rgb = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    path = save_picture(tmp_path / "new" / "a.png", rgb)
    np.testing.assert_array_equal(cv2.imread(str(path))[..., ::-1], rgb)
    with pytest.raises((OSError, cv2.error)):
        save_picture(tmp_path / "a.nothing", rgb)
    assert not (tmp_path / "a.nothing").exists()


SHAPE = (8, 48)


@pytest.fixture
def pair() -> Pair:
    rng = np.random.default_rng(0)
    raster = rng.uniform(0.1, 0.6, SHAPE).astype(np.float32)
    classes = np.full(SHAPE, 7, np.int32)
    everywhere = np.ones(SHAPE, bool)
    rgb = rng.uniform(0, 1, (*SHAPE, 3)).astype(np.float32)
    painted = Painted(30 * raster, 29 * raster, rgb, classes, classes, everywhere, ~everywhere)
    return Pair(painted, raster, raster, raster, PolarImage(30 * raster, raster, everywhere))


def test_cells_without_a_return_are_grey():
    intensity = np.full(SHAPE, 0.3, np.float32)
    valid = np.ones(SHAPE, bool)
    valid[0] = False
    # A return of 0 is one.
    intensity[2] = 0
    panel = intensity_panel(intensity, valid)
    assert (panel[0] == NO_RETURN).all()
    assert not (panel[1:] == NO_RETURN).all(axis=-1).any()


def test_classes_are_a_panel_where_the_camera_knows_them(pair: Pair):
    assert len(input_panels(pair.painted)) == 3
    unknown = pair.painted.replace(semantic=np.zeros(SHAPE, np.int32))
    assert len(input_panels(unknown)) == 2


def test_a_networks_0_is_a_lost_ray(pair: Pair, monkeypatch):
    drawn = []

    def panel(intensity, valid):
        drawn.append(valid)
        return intensity_panel(intensity, valid)

    monkeypatch.setattr("jaxsim.report.pictures.intensity_panel", panel)
    predicted = np.asarray(pair.target).copy()
    predicted[0] = 0
    pair_picture(pair, predicted, title="step 3")
    assert not drawn[0][0].any()
    assert drawn[0][1:].all()


def test_prediction_measurement_and_difference_lie_below_the_input(pair: Pair):
    picture = pair_picture(pair, np.asarray(pair.target), title="step 3")
    simulated = simulated_picture(pair.measured, pair.painted, title="frame")
    height = simulated.shape[0] // 4
    assert picture.shape[0] == 6 * height
    # Prediction and measurement are the same here, so their panels are, below their titles.
    np.testing.assert_array_equal(picture[3 * height + 26 : 4 * height], picture[4 * height + 26 : 5 * height])


def test_a_spread_is_a_panel_of_its_own_below_the_difference(pair: Pair):
    without = pair_picture(pair, np.asarray(pair.target), title="step 3")
    spread = np.full(SHAPE, 0.3, np.float32)
    picture = pair_picture(pair, np.asarray(pair.target), title="step 3", spread=spread)
    np.testing.assert_array_equal(picture[: len(without)], without)
    assert picture.shape[0] == len(without) // 6 * 7


def test_pictures_of_other_frames_take_the_place_of_an_earlier_calls_and_of_nothing_else(tmp_path, caplog):
    grey = np.full((4, 6, 3), 90, np.uint8)

    def there() -> list[str]:
        return sorted(path.name for path in tmp_path.glob("*.png"))

    save_pictures(tmp_path, [("a", grey), ("b", grey), ("c", grey)], by="eval")
    assert not caplog.messages
    (tmp_path / "b.png").write_bytes(b"drawn over by the user")
    (tmp_path / "notes.png").write_bytes((tmp_path / "a.png").read_bytes())
    (tmp_path / "c.png").rename(tmp_path / "kept.png")
    (tmp_path / "c.png").symlink_to("kept.png")
    save_pictures(tmp_path, [("d", grey)], by="eval")
    assert there() == ["b.png", "c.png", "d.png", "kept.png", "notes.png"]
    assert "4 were there before (the first: b.png)" in caplog.messages[0]
    save_pictures(tmp_path, [], by="eval")
    assert "d.png" not in there()


def test_without_a_record_that_can_be_read_no_picture_is_removed(tmp_path, caplog):
    grey = np.full((4, 6, 3), 90, np.uint8)
    save_pictures(tmp_path, [("a", grey)], by="eval")
    (tmp_path / "pictures.json").write_text('{"sha256": {"a.png"')
    save_pictures(tmp_path, [("b", grey)], by="eval")
    assert (tmp_path / "a.png").is_file()
    assert "1 were there before (the first: a.png)" in caplog.messages[0]
