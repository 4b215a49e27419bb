import pytest

from jaxsim.simulate.origin import settle_origin

MADE = {"sensor": "4f2a", "data": "synthetic", "seed": 0}


@pytest.fixture
def out(tmp_path):
    """A folder that holds a frame made so."""
    settle_origin(tmp_path, **MADE)
    (tmp_path / "polar").mkdir()
    (tmp_path / "polar" / "a.npz").touch()
    return tmp_path


def test_the_same_making_resumes(out):
    settle_origin(out, **MADE)


@pytest.mark.parametrize(
    ("change", "meaning"),
    [
        ({"sensor": "93c1"}, "another trained sensor"),
        ({"data": "kitti_raw"}, "another data set"),
        ({"seed": 1}, "another --seed"),
    ],
)
def test_frames_of_another_making_are_not_added(out, change, meaning):
    with pytest.raises(ValueError, match=f"{meaning}.*give another --out"):
        settle_origin(out, **(MADE | change))
    settle_origin(out, **MADE)


def test_a_folder_without_frames_may_change_its_making(tmp_path):
    settle_origin(tmp_path, **MADE)
    settle_origin(tmp_path, **(MADE | {"seed": None}))


def test_frames_that_do_not_say_their_making_are_not_added_to(out):
    (out / "simulation.json").unlink()
    with pytest.raises(ValueError, match="something that left no simulation"):
        settle_origin(out, **MADE)


def test_a_damaged_note_says_so(out):
    (out / "simulation.json").write_text("{")
    with pytest.raises(ValueError, match="no readable JSON"):
        settle_origin(out, **MADE)
