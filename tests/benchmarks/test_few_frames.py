"""What the study of few frames says of its pairs."""

from benchmarks.studies.few_frames import Judged, frames_of, summary


def test_a_drives_frames_are_found_wherever_they_lie():
    assert frames_of(["b", "a", "b", "c"]) == {"b": [0, 2], "a": [1], "c": [3]}


def test_pairs_in_which_the_network_is_worse_are_listed_the_worst_first():
    pairs = [Judged("a", "b", 0.11, 0.10), Judged("a", "c", 0.08, 0.10), Judged("b", "c", 0.13, 0.10)]
    first, table = summary(pairs).split("\n\n")
    assert first == "3 pairs of drives: network 0.1067, per-row median 0.1000; worse in 2"
    assert [line.split(" | ")[:2] for line in table.splitlines()[2:]] == [["| b", "c"], ["| a", "b"]]
