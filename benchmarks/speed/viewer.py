"""How fast the viewer of a page turns a cloud, in a Chromium without a GPU.

    python benchmarks/speed/viewer.py [--points 100000] [--seconds 5] [--width 1400] [--processors 0]

Prints, for a page of one cloud and for one of two under the slider: frames a second of a turn as somebody sees it who
drags (at half the resolution, and as many points as there is time for), the share of the points that it draws then, and
frames a second with all points and all pixels, as at rest; each with the processor time of a frame over all processes,
which other work on the machine changes less. SwiftShader draws; give as `--processors` those that nothing
else uses. Needs Playwright and the system's Chromium: pip install '.[test]', apt-get install chromium.
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, sync_playwright

from jaxsim.report.scenes import Side, TurnedScene, side_of, write_clouds

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def sweep(count: int) -> np.ndarray:
    """A turn of a LiDAR 1.7 m above the ground amid walls, (count, 4)."""
    random = np.random.default_rng(0)
    azimuth = random.uniform(-np.pi, np.pi, count)
    elevation = random.uniform(-0.4, 0.03, count)
    walls_m = 15 + 20 * np.abs(np.sin(3 * azimuth))
    range_m = np.minimum(1.7 / np.maximum(np.sin(-elevation), 1e-3), walls_m)
    flat_m = range_m * np.cos(elevation)
    points = [
        flat_m * np.cos(azimuth),
        flat_m * np.sin(azimuth),
        range_m * np.sin(elevation),
        random.uniform(0, 1, count),
    ]
    return np.stack(points, -1).astype(np.float32)


def processor_s() -> float:
    """Processor time of this process and all that it started, seconds."""
    seen = {os.getpid()}
    ticks = 0
    # A child's number is larger than its parent's, unless numbers begin anew.
    for number in sorted(int(one) for one in os.listdir("/proc") if one.isdigit()):
        try:
            fields = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if number in seen or int(fields[1]) in seen:
            seen.add(number)
            ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def measure(chromium: Browser, page: Path, *, width: int, seconds: float) -> str:
    """The numbers of a page, in words."""
    tab = chromium.new_page(viewport={"width": width, "height": 900})
    tab.goto(page.as_uri())
    tab.evaluate("jaxsimViewer.turning(1)")
    begun_s = processor_s()
    turning, share = tab.evaluate(f"jaxsimViewer.turning({seconds})")
    turned_s = processor_s()
    whole = tab.evaluate("jaxsimViewer.speed(20)")
    ended_s = processor_s()
    canvas = tab.evaluate("[document.getElementById('cloud').width, document.getElementById('cloud').height]")
    tab.close()
    of_turning = 1000 * (turned_s - begun_s) / max(turning * seconds, 1)
    of_whole = 1000 * (ended_s - turned_s) / 20
    words = f"{turning:.1f} frames/s while it turns ({of_turning:.0f} ms of processor time)"
    words = f"{words}, {100 * share:.0f} % of the points"
    return f"{words}; {whole:.1f} frames/s with all ({of_whole:.0f} ms), {canvas[0]} x {canvas[1]} pixels"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=100_000)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--width", type=int, default=1400)
    parser.add_argument("--processors", type=int, nargs="+")
    args = parser.parse_args()
    if args.processors:
        # What is started from here keeps to them, too.
        os.sched_setaffinity(0, args.processors)
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        raise SystemExit("viewer: no Chromium on this machine; apt-get install chromium")
    left = side_of("simulated", sweep(args.points))
    right = Side("measured", left.xyz, left.values)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=program, args=FLAGS)
        for name, sides in (("one cloud", (left,)), ("two, under the slider", (left, right))):
            scene = [TurnedScene(name, sides)]
            page = write_clouds(Path(folder) / "page.html", scene, title=name, sentence=name, words=name)
            print(f"{name}: {measure(chromium, page, width=args.width, seconds=args.seconds)}", flush=True)
        chromium.close()


if __name__ == "__main__":
    main()
