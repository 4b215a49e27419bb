"""One network of the paper's first table, on the embedded world, small: `--prepare.inputs` says which.

    jaxsim eval ablation --train ablation --fid random --fid-features 64     # all five, and the table

All five trained and judged in 23 minutes on two cores, from nothing. Intensity MAE on 80 frames of unseen streets: rgb
0.0885, semantic 0.0910, edges 0.1001, depth 0.0986, combined 0.0724; per-class mean 0.1128.
"""

from dataclasses import replace

from configs.synthetic import experiment as synthetic

experiment = replace(
    synthetic,
    data=replace(synthetic.data, train="0-1919:8", validation="1920-2079:2"),
    prepare=replace(synthetic.prepare, inputs=("rgb", "depth", "semantic", "edges", "row"), network_size=(44, 372)),
    generator=replace(synthetic.generator, downsamples=1),
    optim=replace(synthetic.optim, steps=900),
    run=replace(synthetic.run, name="ablation", save_every=300, picture_every=300),
)
