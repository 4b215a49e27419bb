"""Small verdicts, of judge scenes that gain in their intensities."""

from jaxsim.discover.verdict import Verdict
from jaxsim.discover.verdict.parts import Gained, Gap, Interval, Named, Rank


def effect(name: str, *channels: str, **parameters: Interval) -> Named:
    return Named(name, (), {}, channels, 0.01, Interval(3, 1, 5, "nats per scene"), {**parameters})


def verdict(low: float, *effects: Named) -> Verdict:
    gained = Gained(low + 1, low, low + 2, floor=0, placebo=0, win_rate=1)
    still = Gained(0, -1, 1, floor=0, placebo=0, win_rate=0.5)
    gaps = {"intensity": gained, "range": still, "drop": still}
    return Verdict(
        verdict="named" if effects else "none",
        effects=effects,
        where=(),
        unexplained=None,
        gap={k: Gap(1, 1, -1, 1, "", 1, 1, 0.5, gained=g) for k, g in gaps.items()},
        closure=None,
        find=("a", "b"),
        judge=("c",),
        sha256="",
        frames=3,
        seconds=1,
        ranking=(Rank("beam_gain", 3, 0.01, 1, ""), Rank("saturation", 1, 0.1, 1, "weak")),
    )
