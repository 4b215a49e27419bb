import pytest

from jaxsim.simulate.folder import claim_frames

MADE = {"sensor": "4f2a", "data": "synthetic", "seed": 0}


@pytest.fixture
def out(tmp_path):
    """A folder that holds a frame made so."""
    claim_frames(tmp_path, **MADE)
    (tmp_path / "polar").mkdir()
    (tmp_path / "polar" / "a.npz").touch()
    return tmp_path


def test_the_same_making_resumes(out):
    claim_frames(out, **MADE)


@pytest.mark.parametrize(
    ("change", "meaning"),
    [
        ({"sensor": "93c1"}, r"sensor was 4f2a, now 93c1"),
        ({"data": "kitti_raw"}, "data was synthetic, now kitti_raw"),
        ({"seed": 1}, "seed was 0, now 1"),
    ],
)
def test_frames_of_another_making_are_not_added(out, change, meaning):
    with pytest.raises(ValueError, match=f"{meaning}.*give another --out"):
        claim_frames(out, **(MADE | change))
    claim_frames(out, **MADE)


def test_a_folder_without_frames_may_change_its_making(tmp_path):
    claim_frames(tmp_path, **MADE)
    claim_frames(tmp_path, **(MADE | {"seed": None}))


def test_frames_that_do_not_say_their_making_are_not_added_to(out):
    (out / "simulation.json").unlink()
    with pytest.raises(ValueError, match=r"no simulation\.json says"):
        claim_frames(out, **MADE)


def test_a_damaged_note_says_so(out):
    (out / "simulation.json").write_text("{")
    with pytest.raises(ValueError, match="cannot be read"):
        claim_frames(out, **MADE)
