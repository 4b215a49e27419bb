"""What of a command travels to a worker; tests of the commands run it on a cluster."""

from dataclasses import dataclass
from pathlib import Path

from jaxsim.cli.elsewhere import Elsewhere, OnWorkers, on_cluster
from jaxsim.cluster import Done


@dataclass(frozen=True)
class Named(OnWorkers):
    file: Path
    cluster: str | None = "tcp://a:1"

    def open(self, base: Path):
        return lambda item: f"{self.file} from {base}: {item}"


def test_a_worker_gets_whole_paths_and_the_folder_of_who_asked(tmp_path, monkeypatch):
    (tmp_path / "here").write_text("")
    monkeypatch.chdir(tmp_path)

    def spread(address, job, items, *, by):
        assert (address, by) == ("tcp://a:1", "test")
        assert isinstance(job, Elsewhere)
        work = job.open()
        return (Done(item, work(item), "worker") for item in items)

    monkeypatch.setattr("jaxsim.cli.elsewhere.spread", spread)
    told = [*on_cluster(Named(Path("here")), by="test")([1, 2])]
    assert told == [f"{tmp_path / 'here'} from {tmp_path}: {k}" for k in (1, 2)]
    assert on_cluster(Named(Path("here"), cluster=None), by="test") is None
