"""Where compiled programs are kept."""

from pathlib import Path

from jaxsim.compilation import cache_folder


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


def _homeless(cls) -> Path:
    raise RuntimeError("Could not determine home directory.")
