"""A run and its use: prepared pairs, the run's folder, the learned sensor, its scores."""

from jaxsim.simulate.detector import (
    LearnedDetector,
    experiment_scenes,
    find_all,
    kitti_curves,
    load_detector,
    main_scores,
    make_find,
    mean_curves,
    score_detector,
)
from jaxsim.simulate.fid import frechet_line, frechet_of_run, require_images
from jaxsim.simulate.folders import generation_scores, open_folder
from jaxsim.simulate.predict import make_batch, make_predict, predict_intensity
from jaxsim.simulate.prepared import PreparedPairs, pairs_before, prepared
from jaxsim.simulate.run import Checkpoints, DetectorRun, Run, describe, is_detector, load_run, start_run
from jaxsim.simulate.scores import baseline_scores, score_pairs
from jaxsim.simulate.scribe import Scribe, TrainingDiverged
from jaxsim.simulate.sensor import LearnedSensor, load, simulate_frame

__all__ = [
    "Checkpoints",
    "DetectorRun",
    "LearnedDetector",
    "LearnedSensor",
    "PreparedPairs",
    "Run",
    "Scribe",
    "TrainingDiverged",
    "baseline_scores",
    "describe",
    "experiment_scenes",
    "find_all",
    "frechet_line",
    "frechet_of_run",
    "generation_scores",
    "is_detector",
    "kitti_curves",
    "load",
    "load_detector",
    "load_run",
    "main_scores",
    "make_batch",
    "make_find",
    "make_predict",
    "mean_curves",
    "open_folder",
    "pairs_before",
    "predict_intensity",
    "prepared",
    "require_images",
    "score_detector",
    "score_pairs",
    "simulate_frame",
    "start_run",
]
