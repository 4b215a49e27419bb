"""A run and its use: prepared pairs, the run's folder, the learned sensor, its scores."""

from jaxsim.simulate.fid import frechet_line, frechet_of_run, require_images
from jaxsim.simulate.folders import generation_scores, open_folder
from jaxsim.simulate.predict import make_batch, make_predict, predict_intensity
from jaxsim.simulate.prepared import PreparedPairs, prepared
from jaxsim.simulate.run import Checkpoints, Run, describe, load_run, start_run
from jaxsim.simulate.scores import baseline_scores, score_pairs
from jaxsim.simulate.scribe import Scribe, TrainingDiverged
from jaxsim.simulate.sensor import LearnedSensor, load, simulate_frame

__all__ = [
    "Checkpoints",
    "LearnedSensor",
    "PreparedPairs",
    "Run",
    "Scribe",
    "TrainingDiverged",
    "baseline_scores",
    "describe",
    "frechet_line",
    "frechet_of_run",
    "generation_scores",
    "load",
    "load_run",
    "make_batch",
    "make_predict",
    "open_folder",
    "predict_intensity",
    "prepared",
    "require_images",
    "score_pairs",
    "simulate_frame",
    "start_run",
]
