"""One network of the paper's first table, on the embedded world, small: `--prepare.inputs` says which.

python eval.py ablation --train ablation --fid random --fid-features 64     # all five, and the table
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
