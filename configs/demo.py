"""The embedded world in a few minutes: what `make demo` trains.

    make demo

40 frames, one of each street; the network and the losses of `embedded`, 1500 steps. Made, trained, scored and simulated
in 1:44 minutes on two quiet cores with no compiled program at hand. Intensity MAE 0.0520 on 8 frames of unseen streets;
per-class mean 0.1079, previous frame 0.0748.
"""

from dataclasses import replace

from configs.embedded import experiment as embedded

experiment = replace(
    embedded,
    data=replace(embedded.data, train="0-159:4", validation="1280-1287"),
    optim=replace(embedded.optim, steps=1500),
    run=replace(embedded.run, name="demo", picture_every=500),
)
