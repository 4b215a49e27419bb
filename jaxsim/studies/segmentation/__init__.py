"""What simulated intensity is worth to who tells classes apart: segmentation of range images.

The loop of SqueezeSegV2 (Wu et al. 2019), whose intensities are rendered by a network that learned them from real
scans, with three kinds of training images of the same geometry and labels:

none        no intensity
simulated   that of a sensor which learned it from other parts, from range, place, line and class, and never saw these
measured    the sensor's own

All are judged on measured intensities that neither network saw: of other parts, or of another folder. Without a folder
the images are the embedded world's, whose classes are of paint and water too: a suburb to learn from, a town to judge.

    networks.py   what learns, in memory: the sensor, and who tells classes apart
    study.py      which image simulates, learns or is judged when; how well classes are told, and the table

OUT/settings.json, OUT/images.json (stamps of the folders' images) or OUT/images/{suburb,town}/NAME.npz (of the embedded
world), OUT/intensity/PART.npz, OUT/scores/KIND_part0_seed0.json, OUT/segmentation.{md,json}. Its many small networks
are no runs, each with a folder, checkpoints and a card: they learn in memory (`jaxsim.train.in_memory`), and what
they tell is kept.
"""

from __future__ import annotations

import json
import logging
from pathlib import Path

from jaxsim.config import SegmentationConfig
from jaxsim.data.logs.range_images import CLASSES_FILE, range_image_files
from jaxsim.data.synthetic import SyntheticWorld
from jaxsim.data.synthetic.labelled import LABEL_CLASSES, write_labelled
from jaxsim.data.synthetic.world import FRAMES_PER_DRIVE
from jaxsim.files import claim, claim_settings, stamp, write_text
from jaxsim.progress import Progress
from jaxsim.report.results import write_results
from jaxsim.studies.segmentation.study import INTENSITIES, Study, check_parts

SUBURB, TOWN = "suburb", "town"
_log = logging.getLogger(__name__)


def run_segmentation(config: SegmentationConfig) -> Path:
    """Runs all that is missing, prints the table and gives its path.

    Raises ValueError where there are no range images, too few for the parts, or other ones to judge than to learn from,
    and where OUT holds other settings, or scores of images that have changed since.
    """
    if not config.seeds or len({*config.seeds}) < len(config.seeds):
        raise ValueError(f"segmentation: --seeds are {config.seeds}; give some, and each once")
    if config.network.form != "unet":
        raise ValueError(f"segmentation: --network.form is {config.network.form}; both networks are a unet")
    if config.root is None and config.judged is not None:
        raise ValueError("segmentation: --judged was given without --root, the folder to learn from")
    if config.root is None and config.frames < 2:
        raise ValueError(f"segmentation: --frames is {config.frames}; half of them judge, so give 2 or more")
    kept, free = config.out / "settings.json", ("seeds", "out")
    if config.root is not None:
        study = Study.of_folders(config, config.root, config.judged)
        claim_settings(kept, config, by="segmentation", free=free)
        # A score is of a part, and parts are cut anew where images come or go.
        images = {str(folder): stamp(range_image_files(folder)) for folder in (config.root, config.judged) if folder}
        claim(
            config.out / "images.json",
            images,
            by="segmentation",
            text=json.dumps(images, indent=1),
            note="stamps of the folder's images, which have changed since",
        )
    else:
        # Refused before anything is rendered into a folder that is claimed for it.
        check_parts(config.parts, config.frames, elsewhere=True)
        claim_settings(kept, config, by="segmentation", free=free)
        study = Study.of_folders(config, *_embedded(config.out / "images", config.frames))
    for part in Progress(study.rounds, desc="judging", unit="part"):
        for seed in config.seeds:
            for kind in INTENSITIES:
                study.score(kind, part, seed)
    text = study.text()
    _log.info(text)
    return write_results(config.out, "segmentation", study.plain(), text=text)


def _embedded(folder: Path, frames: int) -> tuple[Path, Path]:
    """Folders of the embedded world's range images after rain, each of a street of its own: a suburb's and a town's."""
    # With one seed the town's streets would be the suburb's, with other traffic.
    for seed, (streets, count) in enumerate(((SUBURB, frames), (TOWN, frames // 2))):
        world = SyntheticWorld(seed, streets=f"wet_{streets}")
        indices = range(0, FRAMES_PER_DRIVE * count, FRAMES_PER_DRIVE)
        write_labelled(folder / streets, world, Progress(indices, desc=f"rendering the {streets}", unit="frame"))
        write_text(folder / streets / CLASSES_FILE, json.dumps(LABEL_CLASSES))
    return folder / SUBURB, folder / TOWN
