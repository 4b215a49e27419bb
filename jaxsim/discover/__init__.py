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
Files in the order in which the data meets them:

    read                         two folders, checked and put side by side; where the sensor stood
    mounting, knocked, unsteady  what of that is put in place first: in all frames, from a moment on, in each
    other_surfaces               rays that meet a surface which one side alone has
    division                     find and judge scenes, and the null model that all that is found stands on
    few_drives                   what is bound to directions, which sectors of few drives cannot show
    covariates, find             on what the disagreement depends
    look_alikes, name, law       which effect it is; what no effect describes, as a law with a formula
    contrast                     how far the sensor follows the simulator's contrast, which a learned one gets wrong
    add                          what was named, fitted together
    regimes, repeats             what acts in a part alone; what comes back at the same rows and columns
    show                         how far the sides are apart on unseen scenes, and what a report draws of them
    relation, sensitivity        whether intensities are related at all; what the frames could show
    levels, objects              noise, and targets, of both sides
    explain, verdict             the answer in plain values
    place, ask, closer           the stages of the whole way: the sensor where it stands; which effect is missing, by
    complete, conclude           a closer look where need be; all of it fitted together; held against unseen scenes, as
                                 a verdict and a sensor model
    workflow                     the whole way
    unpaired                     the whole way where the streets differ
    gate, watch                  whether an answer passes in CI; how a sensor changes over days
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
