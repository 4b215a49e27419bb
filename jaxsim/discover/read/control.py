"""The control: what a simulator lacks of the sensor that it was made after, as an earlier answer says.

A simulator that learned from a sensor lacks what it did not learn, and so does one that was made by hand. Frames of the
same simulator beside drives on which that sensor was as it should be show it, as a control experiment does: an answer
of theirs, put in place first, leaves of other drives what is new on these.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from jaxsim.effects.chain import SensorModel
from jaxsim.files import placed, read_json

MOUNTING = ("extrinsic_rotation", "extrinsic_translation", "beam_elevation_error")
"""Effects that are put in place by casting the simulated frames again (`mounting`)."""


@dataclass(frozen=True)
class Control:
    """What an earlier answer found on frames of the same simulator."""

    model: SensorModel = field(default_factory=SensorModel)
    """Its effects and learned laws, as fitted there."""
    contrast_off: bool = False
    """Whether the sensor did not follow the simulator's contrast there."""

    @property
    def mounting(self) -> SensorModel:
        """Its effects that are of the mounting."""
        pairs = [pair for pair in self.model.effects if pair[0] in MOUNTING and pair[0] not in self.model.regions]
        return SensorModel(tuple(pairs))

    @property
    def of_rays(self) -> SensorModel:
        """All of it that acts on rays as they were cast: all but the mounting."""
        return self.model.without(self.mounting)

    @classmethod
    def load(cls, folder: Path | str, rows: int | None = None) -> Control:
        """The control of the folder that `jaxsim discover --out` wrote, for a sensor of so many beams, if these
        are known.

        Raises ValueError where it holds no paired answer, or one of a sensor of another number of beams.
        """
        folder = Path(folder)
        told = folder / "verdict.json"
        if not told.is_file():
            raise ValueError(
                f"discover: no file {told}; a control is the folder of an earlier answer (`jaxsim discover ... --out "
                "CONTROL`) on frames of the same simulator where the sensor was as it should be"
            )
        content = read_json(told, by="discover")
        with placed(f"discover: {told} is no verdict of `jaxsim discover`", KeyError, TypeError, AttributeError):
            paired, contrast = content["levels"], content.get("contrast")
        if not paired:
            raise ValueError(
                f"discover: {told} is an answer of --unpaired frames, which are not compared ray by ray; give one of "
                "frames of the same names as the control"
            )
        model = SensorModel.load(folder / "sensor.json", rows=rows)
        # Levels are no effects: both sides of the new frames tell theirs.
        return cls(replace(model, levels={}), contrast_off=contrast is not None)


NO_CONTROL = Control()
"""Where none is given: the simulator is taken at its word."""
