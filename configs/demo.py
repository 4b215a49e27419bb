"""The embedded world in a few minutes: what `make demo` trains.

    make demo

40 frames, one of each street; the small network of `embedded`, 200 steps. Processor time: 84 s for the frames, then
about 1 s a step, measured beside other work.
"""

from dataclasses import replace

from configs.embedded import experiment as embedded

experiment = replace(
    embedded,
    data=replace(embedded.data, train="0-159:4", validation="1280-1287"),
    optim=replace(embedded.optim, steps=200),
    run=replace(embedded.run, name="demo"),
)
