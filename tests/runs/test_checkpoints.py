"""A checkpoint is what was saved, or it is refused."""

import gc
import logging
import re
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from jaxsim.runs.run import SUMS, Checkpoints
from tests.full_disk import no_file_above
from tests.programs import said

# Where it fails, Orbax leaves coroutines of a loop that is closed, which say so when they go.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
TREE = {"kernel": np.random.default_rng(0).normal(size=(40, 50)).astype(np.float32), "step": np.int32(7)}


def saved(folder: Path) -> Path:
    """A run with one checkpoint; the files that hold its arrays lie in the folder that comes back."""
    Checkpoints(folder).save(7, state=TREE)
    return folder / "checkpoints" / "7" / "state"


def restored(folder: Path):
    return Checkpoints(folder).restore("state", TREE)


def same(tree) -> bool:
    return jax.tree.all(jax.tree.map(lambda a, b: np.asarray(a).tobytes() == b.tobytes(), tree, TREE))


def test_what_was_saved_is_restored_and_verified(tmp_path):
    saved(tmp_path)
    assert same(restored(tmp_path))


def test_no_flipped_bit_of_150_gives_other_arrays(tmp_path):
    """A bit of the format that means nothing may be flipped; whatever changes an array is refused."""
    folder = saved(tmp_path)
    data = max((path for path in folder.rglob("*") if path.is_file()), key=lambda path: path.stat().st_size)
    whole = data.read_bytes()
    random = np.random.default_rng(1)
    checkpoints, refused = Checkpoints(tmp_path), 0
    for place in random.integers(0, 8 * len(whole), 150):
        flipped = bytearray(whole)
        flipped[place // 8] ^= 1 << (place % 8)
        data.write_bytes(flipped)
        try:
            found = checkpoints.restore("state", TREE)
        except ValueError as error:
            assert "is damaged" in str(error)  # noqa: PT017
            refused += 1
        else:
            assert same(found)
    assert refused >= 140
    data.write_bytes(whole)
    assert same(restored(tmp_path))


def test_what_to_do_about_a_damaged_step_depends_on_whether_another_is_kept(tmp_path):
    def damage(step: int) -> None:
        files = [path for path in (tmp_path / "checkpoints" / str(step)).rglob("*") if path.is_file()]
        largest = max(files, key=lambda path: path.stat().st_size)
        largest.write_bytes(bytes(largest.stat().st_size))

    saved(tmp_path)
    damage(7)
    with pytest.raises(ValueError, match="no other step is kept: bring that folder back from a copy, or train again"):
        restored(tmp_path)
    Checkpoints(tmp_path).save(8, state=TREE)
    damage(8)
    with pytest.raises(ValueError, match=rf"remove {tmp_path}.*/8, and the latest of the other steps \(7\) is used"):
        restored(tmp_path)


@pytest.mark.parametrize("shape", [(40, 25), (50, 40), (2000,)])
def test_arrays_of_another_shape_are_of_another_network(tmp_path, shape):
    """As of a config.json whose number of filters was changed by hand."""
    saved(tmp_path)
    told = rf"another network .*: kernel has the shape \(40, 50\) there, and {re.escape(str(shape))} by the settings"
    with pytest.raises(ValueError, match=told):
        Checkpoints(tmp_path).restore("state", TREE | {"kernel": np.zeros(shape, np.float32)})
    assert same(restored(tmp_path))


def test_a_checkpoint_of_an_earlier_version_is_taken_with_a_word(tmp_path):
    shutil.rmtree(saved(tmp_path).parent / SUMS)
    with pytest.warns(UserWarning, match="saved without a SHA-256 by an earlier version; it is not verified"):
        assert int(restored(tmp_path)["step"]) == 7


def test_looking_for_checkpoints_and_restoring_one_writes_nothing(tmp_path):
    assert Checkpoints(tmp_path / "run").latest is None
    assert Checkpoints(tmp_path / "run").steps == []
    assert not (tmp_path / "run").exists()
    saved(tmp_path)

    def state() -> dict[Path, tuple[int, int]]:
        return {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in tmp_path.rglob("*")}

    before = state()
    assert same(restored(tmp_path))
    assert state() == before


def test_a_moved_run_has_its_checkpoints_and_saves_on(tmp_path):
    saved(tmp_path / "before")
    (tmp_path / "before").rename(tmp_path / "after")
    assert same(restored(tmp_path / "after"))
    Checkpoints(tmp_path / "after").save(8, state=TREE)
    assert Checkpoints(tmp_path / "after").steps == [7, 8]
    assert not (tmp_path / "before").exists()


def test_orbaxs_own_json_that_is_too_deep_names_the_folder(tmp_path):
    (saved(tmp_path).parent / "_CHECKPOINT_METADATA").write_text("[" * 100_000)
    with pytest.raises(ValueError, match=f"run: .*{tmp_path}.* damaged"):
        restored(tmp_path)


def test_a_restore_that_fails_leaves_the_process_as_it_was_but_for_words_of_a_closed_loop(tmp_path, monkeypatch):
    heard = []
    monkeypatch.setattr(sys, "unraisablehook", heard.append)
    absl = logging.getLogger("absl")
    before = absl.level
    saved(tmp_path)
    for _ in range(2):
        with pytest.raises(ValueError, match="of another network"):
            Checkpoints(tmp_path).restore("state", TREE | {"more": np.float32(1)})
        assert absl.level == before
    # Tensorstore may tell the loop of an array for a while; what else is lost is heard, once.
    for words in ("Event loop is closed", "another"):
        sys.unraisablehook(SimpleNamespace(exc_value=RuntimeError(words)))
    assert [str(lost.exc_value) for lost in heard] == ["another"]
    assert sys.unraisablehook.args == (heard.append,)


def test_a_disk_without_room_is_one_line_and_the_step_can_be_saved_later(tmp_path, capfd):
    Checkpoints(tmp_path).save(6, state=TREE)
    with no_file_above(1000), pytest.raises(OSError, match=r"step 7 cannot be saved .*File too large.*make room"):
        Checkpoints(tmp_path).save(7, state=TREE)
    gc.collect()
    assert "Traceback" not in capfd.readouterr().err
    assert Checkpoints(tmp_path).steps == [6]
    saved(tmp_path)
    assert same(restored(tmp_path))


def test_of_many_arrays_that_have_no_room_one_line_is_told(tmp_path):
    program = f"""
import numpy as np
from jaxsim.runs.run import Checkpoints
from tests.full_disk import no_file_above
from tests.programs import said
try:
    with no_file_above(300_000):
        Checkpoints(Path({str(tmp_path)!r})).save(1, state={{f"{{k}}": np.random.rand(100, 100) for k in range(300)}})
except OSError as error:
    print("error:", error)
"""
    output = said(tmp_path, "-c", f"from pathlib import Path{program}")
    assert "error: run: step 1 cannot be saved" in output, output
    assert "Traceback" not in output, output
