"""Real2Sim2Real, the paper's loop: learn the sensor, simulate with it, train detectors, score them on real clouds.

OUT/loop.json         settings; a folder of other settings is refused
OUT/intensity/        the run of the sensor
OUT/discovered/       what `discover` says that it lacks: sensor.json
OUT/trees/KIND/       KITTI trees of the renderer's frames
OUT/detectors/seed0/  a run for each kind, and `real`
OUT/scores/seed0/     TRAINED_on_JUDGED.json

`stages` makes them one after the other; `scores` reads what was scored, `charts` and `page` show it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from jaxsim.config import CloudRecipe, DataConfig, DetectorExperiment, Experiment, LoopConfig
from jaxsim.files import claim_settings

REAL = "real"
CLOUD_KINDS: dict[str, tuple[CloudRecipe, str]] = {
    "raw_64": (CloudRecipe(source="depth", lines="64"), "depth alone, intensity 0, 64 lines"),
    "raw_32": (CloudRecipe(source="depth", lines="32_of_64"), "depth alone, intensity 0, 32 lines"),
    "simulated_64": (CloudRecipe(source="simulated", lines="64"), "intensity and lost rays of the network, 64 lines"),
    "simulated_grid": (
        CloudRecipe(source="simulated", projection="grid"),
        "intensity and lost rays of the network, on the sensor's own grid",
    ),
    "discovered_grid": (
        CloudRecipe(source="simulated", projection="grid"),
        "the same, with the effects that discover found it to lack",
    ),
}
"""How each kind of cloud is made, and in words. The paper's are the first three: VKITTI 64, VKITTI 32, IntensitySim."""
WITH_EFFECTS = ("discovered_grid",)


@dataclass(frozen=True)
class Loop:
    """One loop's folder."""

    config: LoopConfig

    @property
    def out(self) -> Path:
        """The folder of the loop."""
        return self.config.out

    @property
    def intensity(self) -> Path:
        """The run of the intensity network."""
        return self.out / "intensity"

    @property
    def effects(self) -> Path:
        """The effects that it lacks."""
        return self.out / "discovered" / "sensor.json"

    @property
    def target(self) -> str:
        """The class that the detectors find."""
        return self.config.detector.detector.anchors.kind

    def tree(self, kind: str) -> Path:
        """The KITTI tree of a kind of clouds."""
        return self.out / "trees" / kind

    def detector(self, trained: str, seed: int) -> Path:
        """The run of the detector that was trained on a kind of clouds."""
        return self.out / "detectors" / f"seed{seed}" / trained

    def score(self, trained: str, judged: str, seed: int) -> Path:
        """The file of a detector's scores on a kind of clouds."""
        return self.out / "scores" / f"seed{seed}" / f"{trained}_on_{judged}.json"

    @property
    def trained(self) -> tuple[str, ...]:
        """What detectors are trained on, in the order of the table."""
        return (*self.config.kinds, REAL)

    @property
    def judgements(self) -> list[tuple[str, str]]:
        """(trained on, judged on): all on real, and the real one on all."""
        return [(kind, REAL) for kind in self.trained] + [(REAL, kind) for kind in self.config.kinds]

    def recipe(self, kind: str) -> CloudRecipe:
        """How clouds of a kind are made."""
        recipe = CLOUD_KINDS[kind][0]
        return replace(recipe, lines=self.config.lines_32) if kind == "raw_32" else recipe

    def intensity_experiment(self) -> Experiment:
        """The sensor's training, in this folder."""
        settings = self.config.intensity
        return replace(settings, run=replace(settings.run, name="intensity", out=self.out))

    def data_of(self, kind: str) -> DataConfig:
        """Labelled frames of a kind of cloud."""
        if kind == REAL:
            return self.config.detector.data
        cache = self.out / "cache"  # a tree that is deleted and made anew holds other clouds
        return DataConfig(
            kind="kitti_object", root=self.tree(kind), train="train", validation="val", rows="elevation", cache=cache
        )

    def detector_experiment(self, trained: str, seed: int) -> DetectorExperiment:
        """A detector's training, in this folder."""
        settings, path = self.config.detector, self.detector(trained, seed)
        run = replace(settings.run, name=path.name, out=path.parent, seed=seed)
        return replace(settings, data=self.data_of(trained), run=run)


def claim_loop(config: LoopConfig) -> Loop:
    """The loop of these settings; keeps them in its folder. More kinds and more seeds may be asked for later, and all
    else as long as nothing was made.

    Raises ValueError where the folder holds a loop of other settings, naming them, and for settings that cannot be.
    """
    for flag, values in (("kinds", config.kinds), ("seeds", config.seeds)):
        if not values or len({*values}) < len(values):
            raise ValueError(f"real2sim2real: --{flag} are {values}; give some, and each once")
    path = config.out / "loop.json"
    begun = any((config.out / name).exists() for name in ("intensity", "trees", "detectors"))
    claim_settings(path, config, by="real2sim2real", filled=path.is_file() and begun, free=("kinds", "seeds", "out"))
    return Loop(config)
