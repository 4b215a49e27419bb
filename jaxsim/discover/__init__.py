"""Which effect is missing from a simulation: found, named, added, and shown on unseen scenes."""

from jaxsim.discover.read import Comparison, read_comparison
from jaxsim.discover.unpaired import discover_unpaired
from jaxsim.discover.verdict import CurveLine, Result, Verdict
from jaxsim.discover.workflow import disagreements, discover, discover_folders, judge_known

__all__ = [
    "Comparison",
    "CurveLine",
    "Result",
    "Verdict",
    "disagreements",
    "discover",
    "discover_folders",
    "discover_unpaired",
    "judge_known",
    "read_comparison",
]
