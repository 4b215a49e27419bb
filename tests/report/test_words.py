"""A verdict in words."""

from dataclasses import replace

from jaxsim.discover.verdict import InPlace, Interval, Named
from jaxsim.report.words import listed, nuisance, nuisance_title, title_as_found, verdict_sentence
from tests.report import results


def test_sentences():
    named = verdict_sentence(results.named().verdict)
    assert named.startswith("The simulation lacks beam_gain (each beam has its own gain) and range_scale")
    assert "closes 93 % of the explainable gap (90 % interval 88 % to 97 %) on 2 scenes" in named
    assert named.endswith("These data cannot tell beam_gain from focal_compensation.")
    assert verdict_sentence(results.none().verdict).startswith("No missing effect was found")
    outside = verdict_sentence(results.not_in_catalogue().verdict)
    assert outside == (
        "The simulation lacks something that is not in the catalogue: a periodic dependence of intensity on range."
    )
    verdict = results.not_in_catalogue().verdict
    in_time = replace(verdict.unexplained, covariate="frame", character="step")
    assert verdict_sentence(replace(verdict, unexplained=in_time)).endswith(
        "a step dependence of intensity on the time since the first frame."
    )


def test_an_effect_that_the_simulator_has_and_the_sensor_has_not_is_told_as_its_opposite():
    interval = Interval(-0.0087, -0.0116, -0.0059, "1/m")
    gain = Interval(7.0, 4.3, 9.7, "nats per scene")
    haze = Named.alone("atmospheric_extinction", 0.001, gain, parameters={"coefficient_per_m": interval})
    assert title_as_found(haze) == "below 0: the simulator has haze that the street had not"
    parameters = {"coefficient_per_m": replace(interval, value=0.0087)}
    assert title_as_found(replace(haze, parameters=parameters)) == "haze or fog dims the light on its way"
    # Gains of beams may be either anyway, and an effect of one's own is not in the catalogue.
    assert title_as_found(results.named().verdict.effects[0]) == "each beam has its own gain"
    assert title_as_found(replace(haze, name="rain_on_lens")) == ""


def test_without_a_floor_the_sentence_tells_what_the_likelihood_gains():
    verdict = replace(results.named().verdict, closure=None)
    assert (
        "adding them makes the intensities of 2 scenes that nothing was fitted to more probable, by 180 nats per scene "
        "(90 % interval 150 to 210), where free curves gain nothing for certain" in verdict_sentence(verdict)
    )
    # Next to nothing is no share to tell.
    wide = replace(verdict, closure=Interval(7.5, 0.4, 14.6, "share of what free curves gain"))
    assert "closes" not in verdict_sentence(wide)
    assert "by 180 nats per scene (90 % interval 150 to 210), where free curves gain too little" in verdict_sentence(
        wide
    )
    silent = {name: replace(g, gained=None) for name, g in verdict.gap.items()}
    assert "more probable" not in verdict_sentence(replace(verdict, gap=silent))


def test_names_and_noise_are_written_as_people_read_them():
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"], "or") == "a, b or c"
    assert nuisance("drop", 0.0) == "50.0 %"
    assert nuisance("range_", 0.0) == "1.00 m"
    assert nuisance("class 7", 0.5) == "0.500"
    assert nuisance_title("class 7") == "road"
    assert nuisance_title("class 250") == "class 250"
    assert nuisance_title("drop_sky") == "rays lost, beside the sky"
    assert nuisance_title("gain") == "gain"


def test_what_repeats_is_in_the_sentence():
    ripple = (
        "intensity off by 0.200 nats in every scene at the same columns (periods: 16 over the columns, "
        "period 24.0 columns)."
    )
    found = results.repeating().verdict
    assert verdict_sentence(found) == f"The simulation lacks something that is not in the catalogue: {ripple}"
    beside = replace(found, unexplained=results.not_in_catalogue().verdict.unexplained)
    assert verdict_sentence(beside).endswith(f"periodic dependence of intensity on range. Besides, {ripple}")
    named = replace(results.named().verdict, repeats=found.repeats)
    assert verdict_sentence(named).endswith(f"Besides, {ripple}")
    # Where what repeats is what stays unexplained it is told once.
    assert verdict_sentence(replace(named, unexplained=found.unexplained)) == verdict_sentence(named)


def test_what_stays_unexplained_beside_a_name_is_in_the_sentence():
    verdict = replace(results.named().verdict, unexplained=results.not_in_catalogue().verdict.unexplained)
    assert verdict_sentence(verdict).endswith(
        " Besides, there is a periodic dependence of intensity on range that is not in the catalogue."
    )


def test_what_the_simulator_gets_wrong_is_told_apart_from_what_it_lacks():
    told = verdict_sentence(replace(results.none().verdict, contrast=results.contrast()))
    assert told.startswith("No missing effect was found")
    assert "by 1.38 from cell to cell and, least of all, by 0.100 within road: the simulator's error" in told
    assert "simulator's error" not in verdict_sentence(results.none().verdict)


def test_what_a_control_says_that_the_simulator_lacks_stands_aside():
    verdict = results.named().verdict
    told = verdict_sentence(replace(verdict, control=InPlace(("range_falloff", "snr_dropout"), contrast_off=False)))
    assert told.endswith("lacks by itself (the control): range_falloff and snr_dropout.")
    assert verdict_sentence(replace(verdict, control=InPlace((), contrast_off=False))) == verdict_sentence(verdict)
