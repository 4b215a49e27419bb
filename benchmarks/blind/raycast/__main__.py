"""python -m benchmarks.blind.raycast make DIR"""

from __future__ import annotations

import argparse
import sys

from benchmarks.blind.raycast.case import GIVEN, PLACES, make_case
from benchmarks.blind.raycast.effects import EFFECTS
from benchmarks.blind.raycast.nuisance import LEVELS
from benchmarks.blind.raycast.sensors import SENSORS
from benchmarks.blind.raycast.simulators import SIMULATORS


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.raycast", description=__doc__)
    make = parser.add_subparsers(dest="command", required=True).add_parser(
        "make", help="write DIR/measured, DIR/simulated and DIR.key.json", epilog=f"effects: {', '.join(EFFECTS)}"
    )
    make.add_argument("folder", metavar="DIR")
    make.add_argument("--seed", type=int, required=True)
    make.add_argument("--effect", default="none", help="none, NAME or A+B")
    make.add_argument("--severity", type=float, default=2.0, help="multiple of the unit in hidden/units.json")
    make.add_argument("--nuisance", choices=LEVELS, default="default")
    make.add_argument("--simulator", choices=SIMULATORS, default="ideal", help="errors of the simulated side")
    make.add_argument("--place", choices=(*PLACES, "any"), default="any")
    make.add_argument("--sensor", choices=SENSORS, default="spin64")
    make.add_argument("--given", choices=GIVEN, default="all", help="arrays of the simulated side")
    make.add_argument("--scenes", type=int, default=16)
    make.add_argument("--rows", type=int, default=0, help="0: the sensor's")
    make.add_argument("--columns", type=int, default=0, help="0: the sensor's")
    options = vars(parser.parse_args(argv))
    del options["command"]
    try:
        key = make_case(**options)
    except (ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    print(f"case {key['case']}: {options['folder']}/measured, {options['folder']}/simulated")
    return 0


if __name__ == "__main__":
    sys.exit(main())
