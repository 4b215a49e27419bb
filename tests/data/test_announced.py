"""grid.json while frames come: it names them all in the end, and is not written anew for each."""

from typing import Any

import numpy as np
import pytest

from jaxsim.data.polar_frames import Announced, read_grid
from jaxsim.frame import PolarGrid

GRID = PolarGrid(np.linspace(1, -1, 6, dtype="f4"), np.linspace(0, -0.3, 4, dtype="f4"), np.zeros(4, "f4"))


def about(k: int) -> dict[str, dict[str, Any]]:
    """What grid.json says of a frame, by its name."""
    return {f"{k:05d}": {"scene": "x", "time": float(k)}}


def test_all_frames_are_named_in_the_end_and_writing_takes_its_share_alone(tmp_path, monkeypatch):
    written = []

    def write(folder, grid, *, frames):
        written.append(len(frames))

    monkeypatch.setattr("jaxsim.data.polar_frames.write_grid", write)
    clock = iter(range(10**6))
    monkeypatch.setattr("time.monotonic", lambda: next(clock))  # each look at the clock is a second later
    with Announced(tmp_path, GRID) as announced:
        for k in range(2000):
            announced.add(about(k))
    # Writing takes a second here, of twenty-one: no more than one batch in about twenty is written.
    assert written[0] == 1
    assert written[-1] == 2000
    assert len(written) < 2000 / 18


def test_what_was_announced_is_known_to_the_next_command_and_another_grid_is_refused(tmp_path):
    with Announced(tmp_path, GRID) as announced:
        announced.add(about(0) | about(1))
        announced.add(about(2))
    assert [*read_grid(tmp_path)[1]] == [*Announced(tmp_path, GRID).frames] == ["00000", "00001", "00002"]
    other = PolarGrid(GRID.azimuth_rad[:-1], GRID.elevation_rad, GRID.origin_m)
    with pytest.raises(ValueError, match=r"frames of another grid \(4 x 6 cells; these have 4 x 5\)"):
        Announced(tmp_path, other)


def test_an_interrupt_writes_down_what_is_done(tmp_path):
    def stopped() -> None:
        with Announced(tmp_path, GRID) as announced:
            for k in range(50):
                announced.add(about(k))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert len(read_grid(tmp_path)[1]) == 50


def test_frames_stand_in_the_order_that_was_asked_for_however_they_came(tmp_path):
    with Announced(tmp_path, GRID) as announced:
        announced.add(about(9))
    with Announced(tmp_path, GRID, order=["00000", "00001", "00002"]) as announced:
        for k in (2, 0, 1):
            announced.add(about(k))
    assert [*read_grid(tmp_path)[1]] == ["00009", "00000", "00001", "00002"]
