"""Place: where the sensor stands, and what is left over once it stands there; naming begins with that.

A mounting that is clearly off is put in place first, for nothing else can be asked across it, be it in a part of the
recording alone (`mounting.change`); so is what is bound to directions of few drives, which their sectors cannot show.
After each, what the null leaves is found again.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from jaxsim.discover.find.dependences import Dependences, find_dependences
from jaxsim.discover.find.division import Division, NullModel
from jaxsim.discover.mounting.change import Knock, find_knock
from jaxsim.discover.mounting.constant import Mounting, place_mounting, refine_lift
from jaxsim.discover.mounting.per_frame import is_unsteady, steadied
from jaxsim.discover.read import Comparison
from jaxsim.discover.show.few_drives import OfPieces, ask_pieces
from jaxsim.effects import Effect
from jaxsim.effects.chain import SensorModel
from jaxsim.progress import Log


@dataclass(frozen=True)
class Standing:
    """A comparison with the sensor where its frames were registered, in scenes that find and scenes that judge."""

    mounting: Mounting
    """The comparison, as seen from where the sensor stands, and what is known of the sensor."""
    division: Division
    knock: Knock | None
    """Where the sensor stands in a part of the recording; that is in place."""

    @classmethod
    def of(cls, comparison: Comparison, candidates: Collection[str], known: SensorModel, *, log: Log) -> Standing:
        """Puts in place what is clearly off and among the `candidates`: a mounting of all frames, one of a part of
        them, or frames that each stand elsewhere.

        Raises ValueError where the scenes are too few to decide anything.
        """
        mounting = place_mounting(comparison, candidates, known)
        division = Division.of(mounting.comparison)
        parts = division.parts
        log(f"{len(parts.find)} scenes to find with, {len(parts.judge)} to judge on: split {parts.sha256}")
        knock = find_knock(mounting.comparison, {*candidates} - {*mounting.effects}, parts)
        if knock:
            log(f"in a part of the recording the sensor stands otherwise: {', '.join(knock.effects)}")
            placed = knock.brought(mounting.comparison)
        elif is_unsteady(mounting.comparison):
            log("frames stand each a little elsewhere: every simulated one is brought to where its partner stood")
            placed = steadied(mounting.comparison)
        else:
            return cls(mounting, division, None)
        return cls(replace(mounting, comparison=placed), Division.of(placed, parts=parts), knock)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that are in place, be it in a part alone."""
        return (*self.mounting.effects, *(self.knock.effects if self.knock else ()))


@dataclass(frozen=True)
class Placed:
    """A comparison with the sensor where it stands, and what is found there."""

    mounting: Mounting
    """The comparison, as seen from where the sensor stands, and what is known of the sensor."""
    found: Dependences
    catalogue: tuple[Effect, ...]
    """The effects that are yet to be asked."""
    of_drive: OfPieces
    """What pieces of few drives named."""
    knock: Knock | None = None
    """Where the sensor stands in a part of the recording; that is in place."""

    @property
    def comparison(self) -> Comparison:
        return self.mounting.comparison

    @property
    def division(self) -> Division:
        return self.found.null_model.division

    def closer(self) -> Placed:
        """The same, with more columns of the same frames looked at; itself where there are no more. On what the
        disagreement depends stays as it was found."""
        division = self.division.closer()
        if division is self.division:
            return self
        return replace(self, found=replace(self.found, null_model=NullModel.of(division, self.mounting.known)))

    def with_free_contrast(self) -> Placed:
        """The same, with how far the sensor follows the simulator's contrast left to a nuisance."""
        division = self.division.with_free_contrast()
        return replace(self, found=find_dependences(division, self.mounting.known))


def place(comparison: Comparison, catalogue: Sequence[Effect], known: SensorModel, *, log: Log) -> Placed:
    """The comparison with the sensor where it stands, and what the find scenes show there before any other effect of
    the `catalogue` is added to those that are `known`.

    Raises ValueError where the scenes are too few to decide anything.
    """
    standing = Standing.of(comparison, [effect.name for effect in catalogue], known, log=log)
    mounting = standing.mounting
    found = find_dependences(standing.division, mounting.known)
    finer = refine_lift(comparison, mounting, found.null_model.problem, known=known)
    # What the null says rests on where the sensor stands: it is asked again from there.
    if finer is not mounting:
        mounting = replace(finer, comparison=steadied(finer.comparison)) if mounting.comparison.own_places else finer
        found = find_dependences(Division.of(mounting.comparison), mounting.known)
    # What a finer look finds to be where the simulator has it is asked like all others.
    in_place = replace(standing, mounting=mounting).effects
    catalogue = [effect for effect in catalogue if effect.name not in in_place]
    of_drive = ask_pieces(found.null_model, catalogue, log=log)
    if of_drive.effects:
        mounting = replace(mounting, known=of_drive.known)
        catalogue = [effect for effect in catalogue if effect.name not in dict(mounting.known.effects)]
        found = find_dependences(found.null_model.division, mounting.known)
    return Placed(mounting, found, tuple(catalogue), of_drive, standing.knock)
