"""How often `discover` is right, on cases whose answer it cannot see: hidden worlds, their rows, their tables.

    python -m benchmarks.blind.hidden make DIR --seed N    one case; `score DIR` opens its key (hidden/README.md)
    python -m benchmarks.blind.mitsuba make OUT --seed N   one of a world whose light Mitsuba computes; same `score`
    python -m benchmarks.blind.effects OUT                 names of hidden effects, of pairs, of none: the main rates
    python -m benchmarks.blind.worlds OUT                  the same in two worlds, with noisy simulators
    python -m benchmarks.blind.where OUT                   where disagreement is found on the same cases
    python -m benchmarks.blind.repeats OUT                 what repeats in sensor coordinates: nulls, planted patterns
    python -m benchmarks.blind.learned OUT                 what learned laws gain, of what the hidden ones do
    python -m benchmarks.blind.carla_round_trip OUT        hidden attributes of CARLA, found, written, simulated again
    python -m benchmarks.blind.unpaired OUT                the same where the sides show different streets
    python -m benchmarks.blind.planted_on_kitti OUT        effects planted on real scans
    python -m benchmarks.blind.real_discovery OUT          real sensors, with a known part of the answer

All but `hidden` and `real_discovery` write one JSON line a case to OUT/cases.jsonl (rows.py), go on when they are
started again, and print their table from the rows; those quoted in docs/discover-rates.md lie in measured/. A row
carries the hash of the code that answered (`rows.code_version`): rows of two versions are not one measurement. plan.py
says which cases there are, case.py takes one from its making to its score, rivals.py says what simpler methods would
answer, tables.py and pictures.py what is shown. `--sealed` asks for cases on which nothing may be tuned.
"""
