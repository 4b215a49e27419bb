"""Where compiled programs are kept."""

from pathlib import Path

import pytest
from jax._src import lru_cache

from jaxsim.compilation import cache_folder, enable_compilation_cache
from tests.full_disk import no_file_above


def test_where_no_folder_can_be_written_to_programs_are_not_kept(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    for home in (tmp_path / "file", Path("/proc/nowhere")):
        monkeypatch.setenv("XDG_CACHE_HOME", str(home))
        assert cache_folder() is None
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert cache_folder() == tmp_path / "cache" / "jaxsim" / "xla"
    assert cache_folder("native") == tmp_path / "cache" / "jaxsim" / "native"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", classmethod(_homeless))
    assert cache_folder() is None


def test_of_a_program_that_a_full_disk_cuts_off_nothing_is_kept(tmp_path):
    enable_compilation_cache()
    kept = lru_cache.LRUCache(str(tmp_path), max_size=-1)
    with no_file_above(1000), pytest.raises(OSError, match="large"):
        kept.put("program", bytes(5000))
    assert not [*tmp_path.iterdir()]
    kept.put("program", b"whole")
    assert kept.get("program") == b"whole"


def _homeless(cls) -> Path:
    raise RuntimeError("Could not determine home directory.")
