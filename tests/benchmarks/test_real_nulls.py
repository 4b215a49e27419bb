"""How real scans are dealt to two sides of one sensor."""

import pytest

from benchmarks.blind.real_nulls import find_scans, later_pairs, still_pairs, two_sides

FILES = {f"{drive}/{k}": None for drive in ("0001", "0002", "0005", "0060") for k in range(4)}


def test_a_standing_drive_s_scans_are_paired_with_the_next_under_one_name():
    simulated, measured = still_pairs(FILES, "0060")
    assert simulated == {"0060/0": "0060/0", "0060/2": "0060/2"}
    assert measured == {"0060/0": "0060/1", "0060/2": "0060/3"}
    with pytest.raises(ValueError, match="drive 0099 has 0 scans; 4 or more"):
        still_pairs(FILES, "0099")


def test_scans_of_moving_cars_are_paired_with_the_next_of_their_drive_within_so_many_seconds():
    files = {f"{drive}/{k:010d}": None for drive, k in
             (("0001", 2), ("0001", 4), ("0001", 8), ("0001", 20), ("0002", 0), ("0005", 3), ("0005", 9), ("0060", 1),
              ("0060", 2))}  # fmt: skip
    simulated, measured = later_pairs(files, 0.4, still="0060")
    assert measured == {"0001/0000000002": "0001/0000000004"}
    assert simulated == {"0001/0000000002": "0001/0000000002"}
    simulated, measured = later_pairs(files, 0.6, still="")
    assert [*measured.values()] == ["0001/0000000004", "0005/0000000009", "0060/0000000002"]
    with pytest.raises(ValueError, match=r"no two scans of a moving car are 0\.1 s apart or less"):
        later_pairs(files, 0.1, still="0060")


@pytest.mark.parametrize("seed", range(5))
def test_no_drive_is_on_both_sides_nor_the_standing_one_on_any(seed):
    sides = two_sides(FILES, "0060", seed)
    drives = [{name.split("/")[0] for name in side} for side in sides]
    assert not drives[0] & drives[1]
    assert drives[0] | drives[1] == {"0001", "0002", "0005"}
    assert sum(map(len, sides)) == 12


def test_scans_are_spread_over_each_drive_and_missing_ones_are_told(tmp_path):
    data = tmp_path / "2011_09_26" / "2011_09_26_drive_0005_sync" / "velodyne_points" / "data"
    with pytest.raises(ValueError, match="give the folder of dates"):
        find_scans(tmp_path, 3)
    data.mkdir(parents=True)
    for k in range(9):
        (data / f"{k:03d}.bin").touch()
    assert list(find_scans(tmp_path, 3)) == ["0005/000", "0005/004", "0005/008"]
