"""A program that test_devices.py starts, once a process: a small network learns, or goes on from a checkpoint.

`python -m tests.small_training FOLDER STEPS SAVE_AT` prints one line of losses a step, as JSON.
"""

import json
import sys
from pathlib import Path

import jax
import numpy as np

from jaxsim import devices
from jaxsim.config import DiscriminatorConfig, Experiment, GeneratorConfig, LossConfig, OptimConfig
from jaxsim.data.batches import batches
from jaxsim.pix2pix import convolution, create_state, make_train_step
from jaxsim.runs.run import Checkpoints

CHANNELS, SIZE = 3, (16, 32)
EXPERIMENT = Experiment(
    generator=GeneratorConfig(filters=4, downsamples=1, blocks=1, enhancers=0),
    discriminator=DiscriminatorConfig(scales=1, filters=4, max_filters=8, layers=1),
    loss=LossConfig(gan=1.0, feature_matching=10.0, reconstruction=5.0),
    optim=OptimConfig(batch=4, ema_start=2),
)


class Pairs:
    """Random items that differ in brightness, contrast and weight: means over a part are not those of the whole."""

    def __len__(self) -> int:
        return 12

    def __getitem__(self, i: int) -> dict[str, np.ndarray]:
        random = np.random.default_rng(i)
        contrast, brightness = 0.3 + 0.05 * i, 0.05 * i
        draw = lambda n: (contrast * random.standard_normal((*SIZE, n)) + brightness).astype(np.float32)  # noqa: E731
        weight = (random.random(SIZE) < (i + 1) / 13).astype(np.float32)
        return {"inputs": draw(CHANNELS), "target": np.tanh(draw(1)), "weight": weight}


@devices.while_all_live()
def main(folder: Path, steps: int, save_at: int) -> None:
    if "--distributed" in sys.argv:
        devices.connect()
    # A few steps run here, and LLVM would work on them far longer than they run.
    convolution.COMPILER_OPTIONS["xla_backend_optimization_level"] = "0"
    optim = EXPERIMENT.optim
    mesh = devices.data_mesh(optim.batch)
    part = {"part": jax.process_index(), "parts": jax.process_count()}
    loader = batches(Pairs(), size=optim.batch, seed=1, **part)
    state = create_state(EXPERIMENT, CHANNELS, seed=jax.process_index())  # only process 0's counts
    step = make_train_step(EXPERIMENT, CHANNELS, mesh=mesh)
    checkpoints = Checkpoints(folder) if devices.is_first() else None
    if checkpoints and checkpoints.latest:
        state = checkpoints.restore("state", state)
    state = devices.everywhere(mesh, state)
    for k in range(int(state.step), steps):
        batch = devices.cut(mesh, loader[k])
        state, metrics = step(state, batch)
        values = {name: float(value) for name, value in metrics.items()}
        whole = devices.to_host(batch)
        values["batch"] = float(np.abs(whole["inputs"]).sum(dtype=np.float64))
        print(json.dumps({"step": k + 1, "devices": jax.device_count(), **values}), flush=True)
        if checkpoints and k + 1 == save_at:
            checkpoints.save(k + 1, state=state, generator=state.ema)
    devices.wait("the end")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
