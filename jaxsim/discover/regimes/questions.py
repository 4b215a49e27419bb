"""What is known of the blocks, and what may divide an effect among them (moments, tags, sectors), each question with
all its regions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxsim.discover.rules import RULES
from jaxsim.effects.region import Region, Span
from jaxsim.effects.scan import Scan
from jaxsim.geometry import spans_turn


@dataclass(frozen=True)
class Facts:
    """What is known of the blocks that an effect was fitted to, and of all frames."""

    scan: Scan
    names: tuple[str, ...]
    """Scenes of all frames."""
    frame: Int[np.ndarray, " b"]
    scene: Int[np.ndarray, " b"]
    """The scene of each block; of few drives, which are cut into sectors of azimuth, the sector of a drive."""
    column: Int[np.ndarray, "b c"]
    """Columns of the blocks."""

    @property
    def sector(self) -> Int[np.ndarray, "b c"]:
        """The sector of each of the blocks' columns."""
        return sectors_of(self.scan)[self.column]

    @property
    def sectors(self) -> int:
        """How many sectors the scan is divided into."""
        return int(sectors_of(self.scan).max()) + 1

    @property
    def scene_count(self) -> int:
        """How many independent scenes (or sectors of few drives) there are."""
        return int(self.scene.max()) + 1

    @property
    def few_drives(self) -> bool:
        """Whether scenes are sectors of several drives, too few to be held against each other."""
        return len(set(self.frame.tolist())) < len(self.frame) and len(set(self.names)) > 1


@dataclass(frozen=True)
class Question:
    """One way to divide the cells, and every region of it."""

    divides: str
    """time, tag, azimuth or scene."""
    regions: tuple[Region, ...]
    inside: Bool[np.ndarray, "k b a"]

    def between_scenes(self, scene: Int[np.ndarray, " b"]) -> Bool[np.ndarray, "k n"] | None:
        """Which scenes each region holds whole; None where it runs through them."""
        whole = np.stack([self.inside[:, scene == n].all((1, 2)) for n in range(int(scene.max()) + 1)], axis=1)
        some = np.stack([self.inside[:, scene == n].any((1, 2)) for n in range(int(scene.max()) + 1)], axis=1)
        return whole if (whole == some).all() else None


def sectors_of(scan: Scan) -> Int[np.ndarray, " c"]:
    """The sector of each column: equal numbers of columns, `Rules.regime_sectors` of them or fewer."""
    columns = scan.range_m.shape[2]
    count = min(RULES.regime_sectors, columns // 4)
    return np.arange(columns) * max(count, 1) // columns


def questions(facts: Facts) -> list[Question]:
    """All that can be asked of these frames. Of few drives nothing: what some have and others have not would be tested
    on sectors that share their drive, and any two drives differ in something."""
    if facts.few_drives:
        return []
    return [*_tags(facts), *_time(facts), *_azimuth(facts)]


def _time(facts: Facts) -> Iterator[Question]:
    """Parts of the recording: from a moment on, or until one; and, as a question of its own, between two, for these are
    many, and all of them would have to be paid for."""
    time_s = np.asarray(facts.scan.time_s, float)
    moment = np.array([time_s[facts.frame[facts.scene == n]].mean() for n in range(facts.scene_count)])
    # A frame belongs to its scene's moment: a cut never runs through a scene.
    of_block = moment[facts.scene]
    if len(set(facts.names)) == 1:
        # Sectors of one drive share all its moments: its frames are divided instead.
        of_block = time_s[facts.frame]
        moment = np.unique(of_block)
    spans = _spans(moment)
    for between in (False, True):
        regions = tuple(Region(time_s=span) for span in spans if (None not in span) == between)
        if regions:
            inside = np.stack([np.asarray(region.in_time(of_block)) for region in regions])
            yield Question("time", regions, _over_sectors(facts, inside))


def _spans(moment: Float[np.ndarray, " m"]) -> list[Span]:
    """Spans with `Rules.regime_fewest_scenes` of the scenes inside and outside, by their moments, which some may share;
    each end halfway between two moments."""
    order, count = np.unique(moment, return_counts=True)
    cuts = [None, *((order[1:] + order[:-1]) / 2).tolist(), None]
    before = [0, *np.cumsum(count).tolist()]
    few, most = RULES.regime_fewest_scenes, len(moment) - RULES.regime_fewest_scenes
    return [
        (cuts[i], cuts[j])
        for i in range(len(order))
        for j in range(i + 1, len(order) + 1)
        if few <= before[j] - before[i] <= most
    ]


def _tags(facts: Facts) -> Iterator[Question]:
    """A question a tag that some scenes have and some do not: whether more acts where it is set."""
    for tag, tagged in facts.scan.tags.items():
        has = np.asarray(tagged)[facts.frame]
        scenes = len(np.unique(facts.scene[has]))
        if min(scenes, len(np.unique(facts.scene[~has]))) >= RULES.regime_fewest_scenes:
            yield Question("tag", (Region(tag=tag),), _over_sectors(facts, has[None]))


def _azimuth(facts: Facts) -> Iterator[Question]:
    """Arcs of the scan, where there are sectors in every scene."""
    count = facts.sectors
    columns = facts.scan.range_m.shape[2]
    turns = bool(spans_turn(facts.scan.grid))
    column = np.arange(count)
    few, many = max(1, round(RULES.regime_least_arc * count)), count // 2
    regions: list[Region] = []
    inside: list[Bool[np.ndarray, " a"]] = []
    for length in range(few, many + 1):
        for first in range(count if turns else count - length + 1):
            # A sector begins at the first column that `sectors_of` gives to it: rounded up.
            begin = -(-first * columns // count)
            end = -(-(first + length) * columns // count)
            regions.append(arc(facts.scan, begin, end - begin))
            inside.append((column - first) % count < length)
    # A single drive is cut into scenes by azimuth: a sector is one, and none can be held against itself.
    if regions and np.ptp(facts.sector, axis=1).min() >= count / 2:
        masks = np.broadcast_to(np.stack(inside)[:, None], (len(regions), len(facts.scene), count))
        yield Question("azimuth", tuple(regions), masks)


def arc(scan: Scan, first: int, length: int) -> Region:
    """The sector of so many columns from the first on."""
    azimuth = np.asarray(scan.grid.azimuth_rad, float)
    step = float(azimuth[0] - azimuth[-1]) / (len(azimuth) - 1)
    # Azimuth falls from column to column, and a column reaches half a step to both sides.
    high = float(azimuth[0]) - (first - 0.5) * step
    return Region(azimuth_rad=(high - length * step, high))


def _over_sectors(facts: Facts, inside: Bool[np.ndarray, "k b"]) -> Bool[np.ndarray, "k b a"]:
    return np.broadcast_to(inside[:, :, None], (*inside.shape, facts.sectors))
