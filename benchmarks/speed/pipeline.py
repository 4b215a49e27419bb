"""Does the data pipeline starve the training step? And how many images a second do training and inference make?

python benchmarks/speed/pipeline.py [EXPERIMENT] [--flags of train.py] [--bench.steps 24] [--bench.rounds 5]

Trains the experiment on its prepared pairs (made where they are missing): blocks of steps with batches from the
pipeline, in turn with blocks that repeat one batch on the device. A pipeline that keeps up has a ratio near 1.
"""

from __future__ import annotations

import itertools
import sys

import jax
import numpy as np
from timing import interleave

from jaxsim.cli.train import parse_experiment
from jaxsim.compilation import enable_compilation_cache
from jaxsim.config import Experiment
from jaxsim.data import open_dataset, select
from jaxsim.data.batches import batches, stack
from jaxsim.pairs.prepared import prepared
from jaxsim.pix2pix import create_state, load_vgg, make_generate, make_train_step
from jaxsim.prepare import input_channels
from jaxsim.simulate.predict import make_predict
from jaxsim.train.intensity_batch import make_batch
from jaxsim.train.training import ahead


def main(experiment: Experiment, *, steps: int, rounds: int) -> None:
    data, prepare, optim, loss = experiment.data, experiment.prepare, experiment.optim, experiment.loss
    dataset = open_dataset(data)
    train = prepared(dataset, select(data.train, dataset), data, prepare=prepare)
    raster = prepare.network_size if optim.scale_limit or len(train.windows) > 1 else None
    loader = batches(train, size=optim.batch, seed=0, flip=optim.flip, scale_limit=optim.scale_limit, raster=raster)
    to_batch = make_batch(prepare, drop_weight=loss.drop_weight, unseen_weight=loss.unseen_weight)
    channels = input_channels(prepare)
    train_step = make_train_step(experiment, channels, vgg=load_vgg(loss.vgg_weights) if loss.perceptual else None)
    state = create_state(experiment, channels, seed=0)
    stream = ahead(loader, 0, sys.maxsize)
    same = to_batch(jax.device_put(loader[0]))

    def run(pairs) -> None:
        nonlocal state
        for batch in pairs:
            state, metrics = train_step(state, batch)
            assert bool(metrics["finite"])  # waits, as train.py does
        jax.block_until_ready(state)

    peers = {
        "one batch, repeated": lambda: run(itertools.repeat(same, steps)),
        "the pipeline": lambda: run(to_batch(pairs) for pairs in itertools.islice(stream, steps)),
    }
    title = f"{steps} training steps of batch {optim.batch}, {prepare.network_size[0]} x {prepare.network_size[1]}"
    seconds = interleave(title, peers, rounds=rounds, warmup=1)
    print(f"  training: {steps * optim.batch / seconds['the pipeline']:.1f} images/s")

    predict, params = make_predict(make_generate(experiment, channels), prepare), state.ema
    for size in (1, 8):
        pairs = jax.device_put(stack([train[k % len(train)] for k in range(size)]))
        one = interleave(
            f"inference, batch {size}, window {train[0].target.shape[0]} x {train[0].target.shape[1]}",
            {"jaxsim": lambda pairs=pairs: np.asarray(predict(params, pairs).reported)},
            rounds=2 * rounds,
        )
        print(f"  inference: {size / one['jaxsim']:.1f} images/s")


if __name__ == "__main__":
    enable_compilation_cache()
    own = {"--bench.steps": 24, "--bench.rounds": 5}
    rest = sys.argv[1:]
    for name in own:
        if name in rest:
            place = rest.index(name)
            own[name] = int(rest[place + 1])
            del rest[place : place + 2]
    main(parse_experiment(rest)[0], steps=own["--bench.steps"], rounds=own["--bench.rounds"])
