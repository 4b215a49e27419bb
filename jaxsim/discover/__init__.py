"""Which effect is missing from a simulation: found, named, added, and shown on unseen scenes.

    read_comparison     two folders of polar frames -> a Comparison, checked
    discover            a Comparison -> a Result: place, ask, complete, conclude (`workflow`: begin reading there)
    discover_folders    the same on two folders
    discover_unpaired   the same where the two folders show different streets
    disagreements       its first step alone, in seconds: where the two sides disagree
    Control             what an earlier answer says that the simulator lacks by itself
    judge_known         the gap that an answer known in advance reaches
    Result, Verdict     the answer with its evidence; what verdict.json holds of it

The likelihood stands in `model`, every threshold of the decision in `rules`, all statistics over scenes in `scenes`.
Rooms in the order in which the data meets them; each one's page has its files, and each imports only rooms before it:

    rules, scenes, verdict   thresholds; splits, signs and intervals over scenes; the answer as plain values
    model                    what a sensor is expected to say of simulated rays, and how likely what it said is
    read                     two folders, checked and put side by side; how far the sensor moved between them
    find                     find and judge scenes, and on what the two sides' disagreement depends
    name                     which effect of the catalogue it is, or none
    law                      what no effect describes, as a law with a formula
    add                      what was named, fitted together
    repeats                  what comes back at the same rows and columns
    regimes                  what acts in a part of the recording alone
    mounting                 a sensor that stands elsewhere: in all frames, from a moment on, in each
    show                     how far the sides are apart on unseen scenes; what the frames could show; words
    stages, workflow         place, ask, complete, conclude: the whole way
    unpaired                 the whole way where the streets differ
    distances, gate, watch   how far two folders are apart; whether an answer passes in CI; a sensor over days
"""

from jaxsim.discover.read import Comparison, read_comparison
from jaxsim.discover.read.control import NO_CONTROL, Control
from jaxsim.discover.show import judge_known
from jaxsim.discover.unpaired.workflow import discover_unpaired
from jaxsim.discover.verdict import CurveLine, Result, Verdict
from jaxsim.discover.workflow import disagreements, discover, discover_folders

__all__ = [
    "NO_CONTROL",
    "Comparison",
    "Control",
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
