"""Sealed cases for discovery: streets in which effects are hidden, by physics that shares nothing with the finder.

make_case(folder, effect=..., severity=..., seed=..., nuisance=...) -> Key; score(key, verdict) -> dict;
list_effects(), list_outside(), list_combinations(size, count, seed). NumPy and SciPy only; nothing of the package
under test is imported.
"""

from benchmarks.blind.hidden.case import Key, case_name, key_path, make_case
from benchmarks.blind.hidden.catalogue import list_combinations, list_effects, list_outside, unit_of
from benchmarks.blind.hidden.score import score, score_case
from benchmarks.blind.hidden.units import oracle_power

__all__ = [
    "Key",
    "case_name",
    "key_path",
    "list_combinations",
    "list_effects",
    "list_outside",
    "make_case",
    "oracle_power",
    "score",
    "score_case",
    "unit_of",
]
