"""The sensor that travels with the package: `jaxsim.load("embedded")`.

    jaxsim train embedded
    jaxsim eval runs/embedded
    python -m jaxsim.simulate.embedded.pack runs/embedded

240 frames, one of each street; a generator of 16 filters. Processor time: 5 minutes for the frames, then about 1 s a
step. What the packaged weights scored stands beside them, in jaxsim/simulate/embedded/card.md.
"""

from dataclasses import replace

from configs.synthetic import experiment as synthetic

experiment = replace(
    synthetic,
    data=replace(synthetic.data, train="0-959:4"),
    generator=replace(synthetic.generator, filters=16),
    optim=replace(synthetic.optim, steps=1500),
    run=replace(synthetic.run, name="embedded", save_every=100, picture_every=250),
)
