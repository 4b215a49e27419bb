"""Every threshold by which `discover` decides, a file for each stage, in the order in which they act.

    read        whether two folders can be compared at all; scenes, and what few of them may decide
    compare     which readings say something; noise and lattices of frames; kinds of surfaces
    find        on which covariates residuals depend
    name        which effect, or none
    learn       what no effect describes: laws, and what repeats
    regimes     whether an effect acts everywhere
    show        what unseen scenes must bear out; what the frames could show; what a verdict lists
    unpaired    where the two sides show different streets
    gate        whether a simulation passes, and whether a sensor is as it was

What the model itself assumes (noise scales, priors, bounds, steps of an optimiser) stands with it (`discover/model`).
Here stands what turns its numbers into an answer: `RULES.bar_nats`, whatever its file. Probabilities and shares are
0..1, gains are nats of log-likelihood on scenes that a fit has not seen, summed over the find scenes.

Each text ends with what its number was set on:
    development     cases of benchmarks/blind whose seeds lie below 10000; how often the rules err, sealed cases tell
                    (docs/discover-rates.md)
    tests/...       the test that shows it on made data, often from both sides
    a convention    others would do as well
    a judgement     reasons at most, no measurement
"""

from dataclasses import dataclass

from jaxsim.discover.rules.compare import CompareRules
from jaxsim.discover.rules.find import FindRules
from jaxsim.discover.rules.gate import GateRules
from jaxsim.discover.rules.learn import LearnRules
from jaxsim.discover.rules.name import NameRules
from jaxsim.discover.rules.read import ReadRules
from jaxsim.discover.rules.regimes import RegimeRules
from jaxsim.discover.rules.show import ShowRules
from jaxsim.discover.rules.unpaired import UnpairedRules


@dataclass(frozen=True)
class Rules(
    GateRules, UnpairedRules, ShowRules, RegimeRules, LearnRules, NameRules, FindRules, CompareRules, ReadRules
):
    """The thresholds of all stages."""


RULES = Rules()
"""The rules that are in force."""
