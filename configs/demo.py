"""The embedded world in a few minutes: what `make demo` trains."""

from dataclasses import replace

from configs.synthetic import experiment as synthetic

experiment = replace(
    synthetic,
    data=replace(synthetic.data, train="0-79", validation="160-167"),
    optim=replace(synthetic.optim, steps=400),
    run=replace(synthetic.run, name="demo"),
)
