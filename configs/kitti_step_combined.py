"""The paper's experiment on KITTI tracking and KITTI-STEP, all inputs: *combined* of its first table (FID 73.81).

    jaxsim train kitti_step_combined --data.root KITTI_TRACKING --loss.vgg-weights vgg19.npz \\
        --prepare.denoise-weights lidia.npz --optim.precision bfloat16

16 sequences, 20 epochs of batch 8, local enhancer, no flip; all else is Imaginaire's shipped configuration
(`ampO1.yaml`): Adam at 2e-4 (its rate falls after 100 epochs, which 20 never reach), Xavier init of gain 0.02, spectral
norm, hinge loss, feature matching 10, perceptual 10, averaged generator from update 500 on. Not run here: no KITTI-STEP
and no VGG-19 weights were at hand.

What the paper leaves open follows its words, and is a flag:

- discriminators: 2, as in the configuration without enhancer; Imaginaire's own enhancer configuration has 3
  (`--discriminator.scales 3`);
- magnification by up to 0.2 and a random crop, as the default configuration has them (`--optim.scale-limit 0` leaves
  frames as they are), after every image is scaled to 64 x 512;
- depth is scaled by `--prepare.max-range-m`;
- which of LIDIA's weights denoise the target: `jaxsim convert lidia model_state_sigma_blind_bw.pt --out lidia.npz`
  makes those that did best in docs/denoising.md (`--prepare.denoise none` leaves targets as measured);
- dense depth is PENet's in the paper: `--prepare.depth penet --prepare.depth-weights penet.npz`, given its weights.
"""

from jaxsim.config import (
    DataConfig,
    DiscriminatorConfig,
    Experiment,
    GeneratorConfig,
    LossConfig,
    OptimConfig,
    PrepareConfig,
    RunConfig,
)

experiment = Experiment(
    data=DataConfig(kind="kitti_step", train="training", validation="evaluation"),
    prepare=PrepareConfig(inputs=("rgb", "depth", "semantic", "edges"), depth="ip_basic", denoise="lidia"),
    generator=GeneratorConfig(),
    discriminator=DiscriminatorConfig(),
    loss=LossConfig(gan=1.0, feature_matching=10.0, perceptual=10.0),
    optim=OptimConfig(lr=2e-4, batch=8, epochs=20, flip=False, scale_limit=0.2, ema_decay=0.999, ema_start=500),
    run=RunConfig(log_every=100, save_every=735, picture_every=3675),  # an epoch is 735 updates
)
