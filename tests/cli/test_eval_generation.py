"""`jaxsim eval generation`."""

import numpy as np
import pytest

from jaxsim.cli import main
from jaxsim.data.polar_frames import write_frame, write_grid
from jaxsim.frame import PolarGrid, PolarImage

pytestmark = pytest.mark.long


def test_two_folders_are_compared_and_written(tmp_path, capsys):
    rng = np.random.default_rng(0)
    grid = PolarGrid(np.linspace(0.5, -0.5, 32), np.linspace(0.0, -0.3, 8), np.zeros(8))
    valid = np.ones((8, 32), bool)
    for name in ("simulated", "measured"):
        write_grid(tmp_path / name, grid)
        for k in range(3):
            range_m = rng.uniform(3, 30, (8, 32)).astype(np.float32)
            write_frame(tmp_path / name, f"f{k}", PolarImage(range_m, np.full((8, 32), 0.5, np.float32), valid))
    folders = [f"--simulated={tmp_path / 'simulated'}", f"--measured={tmp_path / 'measured'}"]
    main(["eval", "generation", *folders, f"--out={tmp_path / 'out'}"])
    assert "3 simulated and 3 measured frames" in capsys.readouterr().out
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"generation.json", "generation.md"}
    with pytest.raises(SystemExit, match=r"generation: .*measured is read, and would be written into"):
        main(["eval", "generation", *folders, f"--out={tmp_path / 'measured'}"])
