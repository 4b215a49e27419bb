"""What the study of few frames says of its pairs."""

from benchmarks.studies.few_frames import BAR, NETWORK, Judged, frames_of, summary


def test_a_drives_frames_are_found_wherever_they_lie():
    assert frames_of(["b", "a", "b", "c"]) == {"b": [0, 2], "a": [1], "c": [3]}


def test_pairs_in_which_the_network_is_worse_are_listed_the_worst_first():
    errors = {("a", "b"): 0.11, ("a", "c"): 0.08, ("b", "c"): 0.13}
    pairs = [Judged(*names, {NETWORK: error, BAR: 0.10}) for names, error in errors.items()]
    first, means, worse, table = summary(pairs).split("\n\n")
    assert first == "3 pairs of drives, MAE in the mean"
    assert means.splitlines()[2:] == [f"| {NETWORK} | 0.1067 |", f"| {BAR} | 0.1000 |"]
    assert worse == f"The network is worse than the {BAR} in 2"
    assert [line.split(" | ")[:2] for line in table.splitlines()[2:]] == [["| b", "c"], ["| a", "b"]]
