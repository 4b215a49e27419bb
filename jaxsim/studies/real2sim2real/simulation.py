"""What the loop's learned sensor lacks, and the clouds that it makes of the renderer's frames."""

from __future__ import annotations

import logging

from jaxsim.data import open_dataset
from jaxsim.data.select import frames_to_judge
from jaxsim.discover import discover_folders
from jaxsim.effects.chain import SensorModel
from jaxsim.effects.own import known_effects
from jaxsim.report.discovery import write_answer
from jaxsim.report.words import verdict_sentence
from jaxsim.simulate.frames import write_pairs
from jaxsim.simulate.sensor import load
from jaxsim.simulate.trees import LabelRules, TreePlan, choose_frames, export_trees
from jaxsim.studies.real2sim2real import WITH_EFFECTS, Loop

_log = logging.getLogger(__name__)


def discover_lacking(loop: Loop) -> None:
    """Writes what `discover` finds the loop's sensor to lack, on frames that it did not learn from."""
    known_effects()
    sensor, out = load(loop.sensor), loop.effects.parent
    data = sensor.run.experiment.data
    dataset = open_dataset(data)
    judged = frames_to_judge("", dataset, validation=data.validation)
    simulated, measured = write_pairs(sensor, dataset, judged, out=out, log=_log.info)
    result = discover_folders(simulated=simulated, measured=measured, log=_log.info)
    page = write_answer(out, result)
    _log.info(f"{verdict_sentence(result.verdict)} {page}")


def export_kinds(loop: Loop) -> None:
    """Writes the trees of all kinds; the renderer's frames are read once for all."""
    source = loop.config.synthetic
    dataset = open_dataset(source)
    frames = f"{source.train},{source.validation}"
    positions, validation = choose_frames(dataset, frames=frames, validation=source.validation)
    labels = LabelRules(occlusion=loop.config.occlusion if source.kind == "vkitti2" else "levels")
    recipes = {kind: loop.recipe(kind) for kind in loop.config.kinds}
    needed = any(recipe.source == "simulated" for recipe in recipes.values())
    learned = load(loop.sensor) if needed else None
    rows = learned and learned.rows
    plans = [
        TreePlan(
            out=loop.tree(kind),
            source=source,
            positions=positions,
            validation=validation,
            recipe=recipe,
            labels=labels,
            learned=learned if recipe.source == "simulated" else None,
            effects_model=SensorModel.load(loop.effects, rows=rows) if kind in WITH_EFFECTS else None,
        )
        for kind, recipe in recipes.items()
    ]
    export_trees(plans, dataset)
