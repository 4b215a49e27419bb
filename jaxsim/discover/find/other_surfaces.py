"""Rays that meet other surfaces on the two sides: no effect of a sensor should explain them.

A simulated street lacks things that the real one has, and the reverse: kerbs, a parked car, one that is a box; and
between two moments things move. Where one side alone has a surface, readings lie before or behind what is simulated, as
those of fog do. But fog returns ray by ray, at ranges of its own, while neighbouring rays that meet a surface read
nearly the same.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from jaxsim.data.cityscapes import IDS, NAMES
from jaxsim.discover.model.evidence import Measured, near_enough
from jaxsim.discover.rules import RULES
from jaxsim.effects import EFFECTS
from jaxsim.effects.rays import Scan
from jaxsim.frame import Array

NEIGHBOURS = ((0, 1), (0, -1), (1, 0), (-1, 0))
"""Rows and columns by which the four neighbours of a ray lie off."""
BESIDE = 2
"""Rows and columns within which the surface is looked for that one side alone met: leaves of a crown lie apart."""
BLOOMING_RAD = 2 * EFFECTS["blooming"].parameters["radius_rad"].high
"""How far from a very bright target glare may be read: twice the largest radius of `blooming`."""


def seen_by_both(scan: Scan, measured: Measured, *, same: Bool[Array, "f r n"]) -> tuple[Scan, Measured]:
    """Both sides (in host memory) with those rays alone; the others count as seen by neither."""
    same = np.asarray(same)
    hit = np.asarray(scan.hit) & same
    slopes = np.where(hit[..., None], scan.slopes, 0).astype(np.float32)
    zeros = {name: np.where(hit, getattr(scan, name), 0) for name in ("range_m", "intensity", "incidence_rad")}
    one = replace(scan, hit=hit, slopes=slopes, **{k: v.astype(np.float32) for k, v in zeros.items()})
    # Where neither hits anything there is nothing to be of another moment.
    return one, replace(measured, valid=np.asarray(measured.valid) & same)


def same_surfaces(scan: Scan, measured: Measured) -> tuple[Scan, Measured]:
    """Both sides (in host memory) without the rays whose ranges are of different surfaces: between two moments things
    move and come out from behind others, which no effect of a sensor should explain. They count as seen by neither.

    A ray is kept by what its neighbours say, not by whether it returned itself: where both sides see one surface to
    both sides of it, a ray that did not return was lost, and the share of these is that of all rays there.
    """
    hit, valid = np.asarray(scan.hit), np.asarray(measured.valid)
    agree = hit & valid & np.asarray(near_enough(measured.range_m, scan.range_m))
    same = hit & _amid(agree) & (agree | ~valid)
    return seen_by_both(scan, measured, same=same)


def surfaces_apart(scan: Scan, measured: Measured) -> Bool[np.ndarray, "f r n"]:
    """The rays that met a surface which one side alone has, of frames of one moment: they and a neighbour of theirs
    read nearly the same, and neither what is simulated there or right beside. Where rays a quarter of the frame away
    read the same often, too, as in fog, it must be two neighbours, or one that has two.

    Beside edges a reading is of the surface next to it, as of a sensor that is turned, and around very bright targets
    it may be of these: such rays stay, and so do single ones.
    """
    hit, valid = np.asarray(scan.hit), np.asarray(measured.valid)
    range_m, read_m = np.asarray(scan.range_m), np.asarray(measured.range_m)
    known = hit & np.asarray(near_enough(read_m, range_m))
    for rows in (-1, 0, 1):
        for columns in (-1, 0, 1):
            aside_m = shifted(range_m, rows, columns)
            known |= shifted(hit, rows, columns) & np.asarray(near_enough(read_m, aside_m))
    glare = np.asarray(near_enough(read_m, scan.glare_m)) & (np.asarray(scan.glare_rad) < BLOOMING_RAD)
    off = valid & ~known & ~glare
    alike = _alike(off, read_m)
    some = np.any(alike, axis=0)
    far = np.any(_alike(off, read_m, away=off.shape[2] // 4), axis=0)
    if far.sum() <= RULES.alike_by_chance * some.sum():
        apart = some
    else:
        core = np.sum(alike, axis=0) >= 2
        apart = core | np.any([one & shifted(core, *by) for one, by in zip(alike, NEIGHBOURS, strict=True)], axis=0)
    # Of what is lost amid such a surface nothing is known either.
    amid = np.sum([shifted(apart, *by) for by in NEIGHBOURS], axis=0) >= 2
    return apart | (amid & ~valid)


def met_by_chance(scan: Scan, measured: Measured) -> Scan:
    """The scan (in host memory) which also hits what the sensor alone met of the surfaces beside: a leaf of the crown
    whose other leaves the simulator's rays meet. Class, thing and angle are of the ray, of those few rows and columns
    off, whose range is nearest to the reading; where none is near enough a ray still hits nothing."""
    names = ("range_m", "hit", "semantic", "instance", "incidence_rad")
    of_scan = {name: np.array(getattr(scan, name)) for name in names}
    read_m, range_m = np.asarray(measured.range_m), np.asarray(scan.range_m)
    hit = np.asarray(scan.hit)
    alone = np.nonzero(np.asarray(measured.valid) & ~hit)
    frame, row, column = alone
    nearest_m = np.full(len(frame), np.inf)
    for rows, columns in product(range(-BESIDE, BESIDE + 1), repeat=2):
        cell = np.array([row + rows, column + columns])
        within = (cell >= 0).all(0) & (cell < np.array(hit.shape[1:])[:, None]).all(0)
        # Beyond the border a ray stands for itself, which hits nothing.
        aside = (frame, np.where(within, cell[0], row), np.where(within, cell[1], column))
        off_m = np.abs(read_m[alone] - range_m[aside])
        near = hit[aside] & np.asarray(near_enough(read_m[alone], range_m[aside])) & (off_m < nearest_m)
        nearest_m = np.where(near, off_m, nearest_m)
        for name in names:
            of_scan[name][tuple(place[near] for place in alone)] = np.asarray(getattr(scan, name))[aside][near]
    return replace(scan, **of_scan)


def _alike(
    off: Bool[np.ndarray, "f r n"], read_m: Float[np.ndarray, "f r n"], *, away: int = 0
) -> list[Bool[np.ndarray, "f r n"]]:
    """For each of the four neighbours, so many columns `away`, whether a ray and it are both off and read the same."""
    others_off, others_m = np.roll(off, away, axis=2), np.roll(read_m, away, axis=2)
    return [
        off & shifted(others_off, *by) & np.asarray(near_enough(read_m, shifted(others_m, *by))) for by in NEIGHBOURS
    ]


def shares_of_classes(apart: Bool[np.ndarray, "f r n"], scan: Scan) -> dict[int, float]:
    """The share of each class's rays that are of surfaces which one side alone has, by Cityscapes id; of frames that
    tell classes."""
    semantic = np.asarray(scan.semantic)
    classes = [int(one) for one in np.unique(semantic) if one != IDS["unlabeled"]]
    return {one: float(apart[semantic == one].mean()) for one in classes}


def apart_in_words(apart: Bool[np.ndarray, "f r n"], scan: Scan) -> str:
    """How many rays are of surfaces that one side alone has, and of which classes most."""
    share = apart.sum() / max((apart | np.asarray(scan.hit)).sum(), 1)
    of_class = shares_of_classes(apart, scan)
    most = sorted(of_class, key=of_class.__getitem__)[: -RULES.apart_classes_told - 1 : -1]
    shares = [f"{100 * of_class[one]:.0f} % of {NAMES[one]}" for one in most]
    where = f" ({', '.join(shares)})" if shares else ""
    return f"{100 * share:.1f} % of the rays{where}"


def shifted(of: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """The value of the ray so many rows and columns further on (f r n), 0 beyond the border."""
    wide = np.pad(of, ((0, 0), (1, 1), (1, 1)))
    return wide[:, 1 + rows : wide.shape[1] - 1 + rows, 1 + columns : wide.shape[2] - 1 + columns]


def _amid(agreed: np.ndarray) -> np.ndarray:
    """Whether both neighbours of a ray, in its row or in its column, agree."""
    of_row = shifted(agreed, 0, 1) & shifted(agreed, 0, -1)
    of_column = shifted(agreed, 1, 0) & shifted(agreed, -1, 0)
    return of_row | of_column
