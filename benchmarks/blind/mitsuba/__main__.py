"""python -m benchmarks.blind.mitsuba make OUT --seed N"""

from __future__ import annotations

import argparse
import sys

from benchmarks.blind.mitsuba.case import GIVEN, key_path, make_case
from benchmarks.blind.mitsuba.effects import EFFECTS
from benchmarks.blind.mitsuba.sensors import SENSORS, SIMULATORS


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.mitsuba", description=__doc__)
    make = parser.add_subparsers(dest="command", required=True).add_parser(
        "make", help="write OUT/measured and OUT/simulated; the key goes to OUT.key.json"
    )
    make.add_argument("out", metavar="OUT", help="case folder; must not hold a case")
    make.add_argument("--seed", type=int, required=True, help="of streets and all else; same seed, same streets")
    make.add_argument("--effect", choices=("none", *EFFECTS), default="none")
    make.add_argument("--severity", type=float, default=2.0, help="multiple of the effect's unit, see effects.py")
    make.add_argument("--simulator", choices=SIMULATORS, default="ideal")
    make.add_argument("--sensor", choices=tuple(SENSORS), default="turn")
    make.add_argument("--given", choices=GIVEN, default="all", help="what the simulated side tells beside its readings")
    make.add_argument("--scenes", type=int, default=16)
    make.add_argument("--rows", type=int, default=48)
    make.add_argument("--columns", type=int, default=384)
    options = vars(parser.parse_args(argv))
    del options["command"]
    try:
        make_case(options.pop("seed"), **options)
    except (ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{options['out']}/measured, {options['out']}/simulated; key {key_path(options['out'])}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
