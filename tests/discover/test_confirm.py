"""Names that unseen scenes confirm, and such that they do not."""

from dataclasses import replace

import pytest

from jaxsim.discover.confirm import WHY_NOT, confirmed, sensor_of, with_mounting
from jaxsim.discover.verdict import Gained, Gap, Interval, Named, Rank, Verdict
from jaxsim.effects.chain import SensorModel


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


GAIN = effect("beam_gain", "intensity")


@pytest.mark.parametrize("low", [0.5, -0.5])
def test_what_judge_scenes_gain_by_in_the_mean_stays_named(low):
    one = verdict(low, GAIN)
    assert confirmed(one) is one


@pytest.mark.parametrize("low", [-1.0, -1.5])
def test_what_they_do_not_gain_by_is_kept_and_not_named(low):
    one = confirmed(verdict(low, GAIN))
    assert (one.verdict, one.effects, one.unconfirmed) == ("none", (), (GAIN,))
    assert "not confirmed on unseen scenes: beam_gain" in one.notes[-1]
    assert [rank.why_not for rank in one.ranking] == [WHY_NOT, "weak"]
    assert one.to_json()["unconfirmed"][0]["name"] == "beam_gain"


def test_a_gain_in_a_channel_that_no_named_effect_has_does_not_count():
    assert confirmed(verdict(0.5, effect("range_noise", "range"))).verdict == "none"


def test_nothing_named_needs_no_confirmation():
    one = verdict(-1.0)
    assert confirmed(one) is one


def test_a_mounting_is_named_before_what_was_found_with_it_in_place():
    turn = effect("extrinsic_rotation", "range", yaw_rad=Interval(0.02, 0.01, 0.03, "rad"))
    added = SensorModel((("beam_gain", {"gain": (0.1,)}),))
    one = with_mounting(verdict(0.5, GAIN), (turn,), ())
    assert [e.name for e in one.effects] == ["extrinsic_rotation", "beam_gain"]
    model = sensor_of(one, added, SensorModel())
    assert model.effects == (("extrinsic_rotation", {"yaw_rad": 0.02}), ("beam_gain", {"gain": (0.1,)}))
    alone = with_mounting(confirmed(verdict(-1, GAIN)), (turn,), ())
    assert (alone.verdict, len(alone.effects), alone.unconfirmed) == ("named", 1, (GAIN,))
    assert [name for name, _ in sensor_of(alone, added, SensorModel()).effects] == ["extrinsic_rotation"]
    unsure = with_mounting(replace(verdict(-1), ranking=()), (), (turn,))
    assert (unsure.verdict, unsure.unconfirmed) == ("none", (turn,))
