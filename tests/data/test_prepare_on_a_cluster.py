"""`jaxsim prepare --cluster` on processes that die, stop and come late."""

import re
import shutil
import signal
from pathlib import Path

import pytest

from jaxsim.config import DataConfig, PrepareConfig
from jaxsim.pairs.sets import make_set
from tests.dask_processes import processes
from tests.programs import running, said, wait_until

pytest.importorskip("distributed", reason="Dask is not installed: pip install -e '.[dask]'")

FLAGS = ["--prepare.inputs", "rgb", "depth", "row", "--prepare.depth", "ip_basic", "--prepare.columns", "64"]
PREPARE = PrepareConfig(inputs=("rgb", "depth", "row"), depth="ip_basic", columns=64)
SET = Path("jaxsim_pairs/kitti_raw/1.0.0")
FRAMES = 48


@pytest.mark.slow
def test_workers_and_the_command_may_die_and_the_bytes_are_those_of_the_plain_command(raw_root, tmp_path):
    drive = raw_root / "2011_09_26/2011_09_26_drive_0002_sync"
    for k in range(1, FRAMES - 2):
        for kind, suffix in (("velodyne_points", "bin"), ("image_02", "png")):
            shutil.copy(drive / kind / f"data/{0:010d}.{suffix}", drive / kind / f"data/{k:010d}.{suffix}")
    out = tmp_path / "out"
    making = out / SET.with_name("1.0.0.making")
    command = ["-m", "jaxsim", "prepare", "kitti_raw", "--root", raw_root, "--out", out, *FLAGS]
    command += ["--pairs-a-file", "1", "--cluster"]

    def made(at_least: int):
        return lambda: len([*making.glob("done/*.json")]) >= at_least

    with processes(tmp_path) as cluster:
        command.append(cluster.address)
        workers = [cluster.worker() for _ in range(3)]
        # The command dies, and a worker with it.
        with running(tmp_path, *command) as process:
            wait_until(made(FRAMES // 6), process)
            process.kill()
        before = {path.name: path.stat().st_mtime_ns for path in making.glob("*.array_record*")}
        noted = {path.stem for path in making.glob("done/*.json")}
        assert len(noted) < FRAMES
        with running(tmp_path, *command) as process:
            wait_until(made(FRAMES // 3), process)
            workers[0].kill()
            workers[1].send_signal(signal.SIGSTOP)
            cluster.worker()  # and one comes late
            output = process.communicate()[0]
        workers[1].send_signal(signal.SIGCONT)
    assert process.returncode == 0, output
    assert int(re.findall(r"workers=(\d+)", output)[-1]) >= 3, output[-2000:]
    now = {path.name: path.stat().st_mtime_ns for path in (out / SET).glob("*.array_record*")}
    assert {name: now[name] for name in noted} == {name: before[name] for name in noted}
    whole = make_set(tmp_path / "whole", DataConfig(kind="kitti_raw", root=raw_root), PREPARE, size=1, workers=2)
    assert {path.name: path.read_bytes() for path in (out / SET).iterdir()} == {
        path.name: path.read_bytes() for path in whole.iterdir()
    }
    assert said(tmp_path, *command[:-2]).startswith(str(out))  # a finished set needs no cluster
