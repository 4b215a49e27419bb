"""Registration alone, on cases whose sensor stands elsewhere: how far off the motion is that it finds.

    python -m benchmarks.blind.placed --degrees 0.2 0.5 1 2 --metres 0.1 0.2 0.5 --lifted 0.5 --nulls 12

A case an axis and size, simulators ideal and noisy in turn, on development seeds; nulls, and effects that move ranges
(`--effects`, at severity 8), stand where the simulator has them. Prints a line a case and a summary.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.blind.hidden.case import make_case
from benchmarks.blind.hidden.placed import Placed
from jaxsim.data.polar_frames import open_polar_frames
from jaxsim.discover.read.registration import Registration
from jaxsim.discover.read.search import register
from jaxsim.effects.scan import scan_of

FIRST_SEED = 400
SEVERITY = 8.0


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--degrees", nargs="*", type=float, default=[])
    parser.add_argument("--metres", nargs="*", type=float, default=[])
    parser.add_argument("--lifted", nargs="*", type=float, default=[])
    parser.add_argument("--nulls", type=int, default=0)
    parser.add_argument("--effects", nargs="*", default=[])
    args = parser.parse_args(argv)
    off = []
    inside = []
    for k, (effect, placed) in enumerate(_plan(args)):
        with TemporaryDirectory() as folder:
            simulator = ("ideal", "noisy")[k % 2] if effect == "none" else "ideal"
            case = Path(folder) / "case"
            make_case(case, effect=effect, severity=SEVERITY, seed=FIRST_SEED + k, simulator=simulator, placed=placed)
            found = register_folders(case)
        truth = _truth(placed)
        error = np.abs(found.motion[:7] - truth)
        off.append(error)
        inside.extend((error <= found.half[:7])[found.half[:7] > 0])
        print(
            f"{effect:22s} {simulator:6s} turned {placed.turned_deg} deg, moved {placed.moved_m} m, lifted "
            f"{placed.lifted_deg} deg: off by {100 * error[:3].max():.1f} cm, {1000 * error[3:].max():.2f} mrad; sure: "
            f"{', '.join(found.sure) or 'nothing'}; driven {_driven(found):.3f} m",
            flush=True,
        )
    errors = np.stack(off)
    print(
        f"{len(errors)} cases: off by {100 * errors[:, :3].max():.1f} cm and {1000 * errors[:, 3:].max():.2f} mrad at "
        f"most, {100 * np.median(errors[:, :3].max(1)):.1f} cm and {1000 * np.median(errors[:, 3:].max(1)):.2f} mrad "
        f"in the middle of the cases' worst; 90 % intervals hold the truth in {100 * np.mean(inside):.0f} %"
    )


def register_folders(case: Path) -> Registration:
    """The registration of a case's two folders."""
    simulated = open_polar_frames(case / "simulated")
    measured = open_polar_frames(case / "measured")
    read = [simulated.read(name) for name in simulated.names]
    about = [simulated.about[name] for name in simulated.names]
    sensed = [measured.read(name)[0] for name in simulated.names]
    scan = scan_of(simulated.grid, [image for image, _ in read], [rasters for _, rasters in read], about=about)
    range_m = np.stack([image.range_m for image in sensed])
    valid = np.stack([image.valid for image in sensed])
    return register(scan, range_m, valid, scenes=[str(one["scene"]) for one in about])


def _plan(args: argparse.Namespace) -> Iterator[tuple[str, Placed]]:
    axes = np.eye(3)
    for size in args.degrees:
        for axis in axes:
            yield "none", Placed(turned_deg=tuple((size * axis).tolist()))
    for size in args.metres:
        for axis in axes:
            yield "none", Placed(moved_m=tuple((size * axis).tolist()))
    for size in args.lifted:
        yield "none", Placed(lifted_deg=size)
    for _ in range(args.nulls):
        yield "none", Placed()
    for name in args.effects:
        yield name, Placed()


def _truth(placed: Placed) -> np.ndarray:
    roll, pitch, yaw = np.deg2rad(placed.turned_deg)
    turned = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_rotvec()
    return np.array([*placed.moved_m, *turned, np.deg2rad(placed.lifted_deg)])


def _driven(found: Registration) -> float:
    return float(np.median(np.abs(found.frames[:, 7])))


if __name__ == "__main__":
    main()
