from pathlib import Path

import pytest

from jaxsim.cli import main
from jaxsim.simulate.folder import Speed
from tests.untrained import tiny_experiment, untrained_run


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    return untrained_run(tmp_path_factory.mktemp("runs") / "tiny", tiny_experiment(validation="0-2"))


def files_of(out: Path) -> dict[str, bytes]:
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}


def test_the_page_is_drawn_again_only_where_it_is_missing_or_frames_are_new(run, tmp_path, monkeypatch):
    drawn = []

    def write_page(out, dataset, positions, *, run):
        drawn.append(len(positions))
        out.mkdir(exist_ok=True)
        (out / "clouds.html").write_text("page")

    monkeypatch.chdir(run.parent)
    monkeypatch.setattr("jaxsim.cli.simulate.write_simulated", write_page)
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
    assert len(made) == 3 + 2 * 3 + 2  # grid, settings, page; a cloud and a frame each; two pictures
