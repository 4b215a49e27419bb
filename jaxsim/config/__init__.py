"""Every stage's settings, as frozen dataclasses. No behaviour lives here but the check of their numbers (ranges.py).

An experiment (`configs/*.py`) is one `Experiment` (intensity.py), `DetectorExperiment` (detector.py) or
`DepthExperiment` (depth.py) value; data.py has what they share, studies.py the studies around them. Every field is a
flag of `jaxsim train` (`--optim.lr 1e-4`). A run folder keeps the whole value as `config.json`.
"""

from jaxsim.config.data import DataConfig, DataKind, FrameSource, InputName, PrepareConfig, RunConfig, Streets
from jaxsim.config.depth import DepthExperiment, Norms, Part, PenetConfig, Stage
from jaxsim.config.detector import (
    AnchorConfig,
    AugmentConfig,
    BackboneConfig,
    DetectorConfig,
    DetectorExperiment,
    OneCycleConfig,
    ProposalConfig,
    RoiConfig,
    VoxelConfig,
)
from jaxsim.config.intensity import (
    QUANTILES,
    DiscriminatorConfig,
    Experiment,
    GeneratorConfig,
    LossConfig,
    OptimConfig,
    Pix2PixForm,
)
from jaxsim.config.studies import CloudRecipe, LoopConfig, SegmentationConfig

__all__ = [
    "QUANTILES",
    "AnchorConfig",
    "AugmentConfig",
    "BackboneConfig",
    "CloudRecipe",
    "DataConfig",
    "DataKind",
    "DepthExperiment",
    "DetectorConfig",
    "DetectorExperiment",
    "DiscriminatorConfig",
    "Experiment",
    "FrameSource",
    "GeneratorConfig",
    "InputName",
    "LoopConfig",
    "LossConfig",
    "Norms",
    "OneCycleConfig",
    "OptimConfig",
    "Part",
    "PenetConfig",
    "Pix2PixForm",
    "PrepareConfig",
    "ProposalConfig",
    "RoiConfig",
    "RunConfig",
    "SegmentationConfig",
    "Stage",
    "Streets",
    "VoxelConfig",
]
