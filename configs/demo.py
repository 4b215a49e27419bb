"""The embedded world in a few minutes: what `make demo` trains."""

from dataclasses import replace

from configs.synthetic import experiment as synthetic

experiment = replace(
    synthetic,
    data=replace(synthetic.data, train="0-319:4", validation="1280-1287"),
    optim=replace(synthetic.optim, steps=400),
    run=replace(synthetic.run, name="demo"),
)
