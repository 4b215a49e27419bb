"""python -m benchmarks.blind.hidden make | score | units"""

from __future__ import annotations

import argparse
import sys

from benchmarks.blind.hidden.case import key_path, make_case
from benchmarks.blind.hidden.catalogue import EFFECTS, OUTSIDE
from benchmarks.blind.hidden.nuisance import LEVELS
from benchmarks.blind.hidden.part import KINDS
from benchmarks.blind.hidden.placed import Placed
from benchmarks.blind.hidden.score import describe, score_case
from benchmarks.blind.hidden.simulator import SIMULATORS
from benchmarks.blind.hidden.units import write_table


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.blind.hidden", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    make = commands.add_parser(
        "make",
        help="write DIR/measured and DIR/simulated; the key goes to DIR.key.json",
        epilog=f"effects: {', '.join(EFFECTS)}; outside: {', '.join(OUTSIDE)}",
    )
    make.add_argument("folder", metavar="DIR", help="case folder; must not hold a case")
    make.add_argument("--seed", type=int, required=True)
    make.add_argument(
        "--effect", default="random", help="NAME, A+B, none, outside:NAME or random (what is hidden is not printed)"
    )
    make.add_argument("--severity", type=float, default=2.0, help="multiple of the effect's unit, see units.json")
    make.add_argument("--nuisance", choices=LEVELS, default="default")
    make.add_argument("--simulator", choices=SIMULATORS, default="ideal", help="errors of the simulated side")
    make.add_argument(
        "--turned", nargs=3, type=float, default=(0, 0, 0), metavar="DEG", help="sensor: roll, pitch, yaw"
    )
    make.add_argument("--moved", nargs=3, type=float, default=(0, 0, 0), metavar="M", help="sensor: x, y, z")
    make.add_argument("--lifted", type=float, default=0.0, metavar="DEG", help="all beams point higher")
    make.add_argument("--late", type=float, default=0.0, metavar="S", help="measured frames are later than simulated")
    make.add_argument("--part", choices=KINDS, help="the effects act in a part alone; frames have tags")
    make.add_argument("--scenes", type=int, default=16)
    make.add_argument("--frames", type=int, default=1, help="frames a scene")
    make.add_argument("--rows", type=int, default=48)
    make.add_argument("--columns", type=int, default=384)
    judge = commands.add_parser("score", help="hold DIR/out/verdict.json against the key; writes score.json beside it")
    judge.add_argument("folder", metavar="DIR", help="case folder")
    judge.add_argument("--verdict", help="the answer, if not DIR/out/verdict.json")
    commands.add_parser("units", help="compute units.json anew: the size of severity 1 of every effect (minutes)")
    args = parser.parse_args(argv)
    try:
        if args.command == "make":
            own = ("command", "folder", "turned", "moved", "lifted", "late")
            options = {k: v for k, v in vars(args).items() if k not in own}
            placed = Placed(tuple(args.turned), tuple(args.moved), args.lifted, args.late)
            options |= {"placed": None if placed == Placed() else placed}
            key = make_case(args.folder, **options)
            print(f"case {key.case}: {args.folder}/measured, {args.folder}/simulated; key {key_path(args.folder)}")
        elif args.command == "score":
            print(describe(score_case(args.folder, args.verdict)))
        else:
            for name, row in write_table()["units"].items():
                less = "<" if row["oracle_is_upper_bound"] else " "
                print(
                    f"{name:28s} {row['unit']:<9g} by {row['by']:6s} oracle {less}{row['oracle']:<9g} {row['amount']}"
                )
    except (ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
