from dataclasses import replace
from pathlib import Path

import pytest

from jaxsim.cli import main
from jaxsim.cli.simulate import Simulate, speed_words
from jaxsim.simulate.folder import Speed
from jaxsim.train.experiments import load_experiment
from tests.untrained import untrained_run


def speed(batches_s):
    return Speed(simulated=20, already=0, batch=8, batches_s=batches_s, total_s=100.0)


def test_the_simulations_speed_leaves_out_compilation_and_all_other_work():
    assert speed_words(speed((30.0, 1.0, 3.0))).startswith("simulation alone 4.00 frames/s")
    assert "100.0 s in all" in speed_words(speed((30.0, 1.0, 3.0)))


def test_one_batch_tells_no_speed():
    assert "frames/s" not in speed_words(speed((30.0,)))


def test_of_a_cluster_the_speed_is_that_of_all_workers():
    assert speed_words(speed((30.0, 30.0)), workers=True).startswith("0.20 frames/s; ")


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "tiny"
    base, _ = load_experiment("synthetic")
    experiment = replace(
        base,
        data=replace(base.data, validation="0-2"),
        prepare=replace(base.prepare, columns=64, network_size=(64, 128)),
        generator=replace(base.generator, filters=4, blocks=1, downsamples=2, enhancer_blocks=1),
    )
    return untrained_run(folder, experiment)


def files_of(out: Path) -> dict[str, bytes]:
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}


def test_the_page_is_drawn_again_only_where_it_is_missing_or_frames_are_new(run, tmp_path, monkeypatch):
    drawn = []

    def write_page(self, dataset, positions):
        drawn.append(len(positions))
        self.page.parent.mkdir(exist_ok=True)
        self.page.write_text("page")

    monkeypatch.chdir(run.parent)
    monkeypatch.setattr(Simulate, "write_page", write_page)
    for simulated in (0, 0, 1):
        done = Speed(simulated=simulated, already=3, batch=8, batches_s=(), total_s=1.0)
        monkeypatch.setattr("jaxsim.cli.simulate.simulate_folder", lambda *_, done=done, **__: done)
        main(["simulate", "tiny", "--previews", "2", "--out", str(tmp_path / "sim")])
    assert drawn == [2, 2]


@pytest.mark.slow
def test_a_clusters_workers_write_the_files_of_the_plain_command(run, tmp_path, scheduler, monkeypatch):
    monkeypatch.chdir(run.parent)
    command = ["simulate", "tiny", "--batch", "2", "--formats", "bin", "--previews", "1", "--out"]
    main([*command, str(tmp_path / "plain")])
    main([*command, str(tmp_path / "spread"), "--cluster", scheduler])
    made = files_of(tmp_path / "spread")
    assert made == files_of(tmp_path / "plain")
    assert len(made) == 2 + 2 * 3 + 2
