"""What of a command travels to a worker; tests of the commands run it on a cluster."""

from dataclasses import dataclass, replace
from pathlib import Path

from jaxsim.cli.elsewhere import Elsewhere, OnWorkers, on_cluster
from jaxsim.cluster import Done
from jaxsim.simulate.learned_sensor import LearnedSensor, load


@dataclass(frozen=True)
class Named(OnWorkers):
    file: Path
    cluster: str | None = "tcp://a:1"

    def maker(self, load_run):
        learned = load_run(Path("run"))
        return lambda item: f"{self.file} with frames of {learned.run.experiment.data.root}: {item}"


def test_a_worker_gets_whole_paths_and_the_folder_of_who_asked(tmp_path, monkeypatch):
    for name in ("here", "data"):
        (tmp_path / name).write_text("")
    (tmp_path / "worker").mkdir()
    monkeypatch.chdir(tmp_path)

    def spread(address, job, items, *, by):
        assert (address, by) == ("tcp://a:1", "test")
        assert isinstance(job, Elsewhere)
        monkeypatch.chdir(tmp_path / "worker")
        work = job.open()
        return (Done(item, work(item), "worker") for item in items)

    monkeypatch.setattr("jaxsim.cli.elsewhere.spread", spread)
    asked = []
    monkeypatch.setattr("jaxsim.cli.elsewhere.check_scheduler", lambda address, *, by: asked.append((address, by)))
    embedded = load("embedded")
    experiment = embedded.run.experiment
    experiment = replace(experiment, data=replace(experiment.data, root=Path("data")))
    learned = LearnedSensor(replace(embedded.run, experiment=experiment), embedded.params)
    monkeypatch.setattr("jaxsim.cli.elsewhere.load", lambda run: learned)
    shared = on_cluster(Named(Path("here")), by="test")
    assert asked == [("tcp://a:1", "test")]  # before anything is begun
    told = [*shared([1, 2])]
    assert told == [f"{tmp_path / 'here'} with frames of {tmp_path / 'data'}: {k}" for k in (1, 2)]
    assert on_cluster(Named(Path("here"), cluster=None), by="test") is None
