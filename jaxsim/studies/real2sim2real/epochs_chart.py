"""Chart of Real2Sim2Real: how detectors end their training."""

from __future__ import annotations

import numpy as np

from jaxsim.metrics.detection import COLUMNS
from jaxsim.report.canvas import FAINT, INK, RULE, Canvas
from jaxsim.studies.real2sim2real.cloud_charts import COLOURS, colour_key
from jaxsim.studies.real2sim2real.scores import read_checkpoints
from jaxsim.studies.real2sim2real.settings import REAL, Loop

_LEFT = 60
_TOP = 40
_KEY = 130


def epochs_chart(loop: Loop) -> Canvas | None:
    """Moderate 3D AP on real clouds at each of the last checkpoints: a line a kind, the mean over the seeds, and a thin
    line a seed. None where nothing is scored."""
    kinds = (REAL, *loop.config.kinds)
    known = {
        kind: [found for seed in loop.config.seeds if (found := read_checkpoints(loop, kind, REAL, seed=seed))]
        for kind in kinds
    }
    key = f"{COLUMNS[0][0]} {COLUMNS[0][1]} moderate"
    lines = {
        kind: [[c["ap_r40"][key] for c in one] for one in seeds]
        for kind, seeds in known.items()
        if seeds and seeds[0][0]["ap_r40"].get(key) is not None
    }
    if not lines:
        return None
    count = min(len(one) for seeds in lines.values() for one in seeds)
    top = max(10.0, float(np.ceil(max(max(one) for seeds in lines.values() for one in seeds) / 10) * 10))
    width, height = 560, 260
    canvas = Canvas(max(_LEFT + width + 20, _LEFT + _KEY * len(kinds)), _TOP + height + 50)
    colour_key(canvas, kinds, left=_LEFT, step=_KEY)
    x = _LEFT + width * (np.arange(count) + 0.5) / count
    for part in range(6):
        y = _TOP + height * (1 - part / 5)
        canvas.line([(_LEFT, y), (_LEFT + width, y)], colour=RULE, width=0.5)
        canvas.text(_LEFT - 6, y + 4, f"{top * part / 5:g}", anchor="end", size=11, colour=FAINT)
    for k in range(count):
        words = "last" if k == count - 1 else f"last - {count - 1 - k}"
        canvas.text(float(x[k]), _TOP + height + 16, words, anchor="middle", size=11, colour=FAINT)
    for kind, seeds in lines.items():
        colour = COLOURS[kinds.index(kind)]
        values = np.array([one[-count:] for one in seeds], float)
        for one in values if len(values) > 1 else ():
            canvas.line(np.column_stack([x, _TOP + height * (1 - one / top)]), colour=colour, width=0.5)
        y = _TOP + height * (1 - values.mean(0) / top)
        canvas.line(np.column_stack([x, y]), colour=colour, width=2)
        for a, b in zip(x, y, strict=True):
            canvas.dot(float(a), float(b), colour=colour, radius=3)
    canvas.text(_LEFT + width / 2, _TOP + height + 36, "checkpoint", anchor="middle", size=12, colour=INK)
    canvas.text(14, _TOP + height / 2, "3D AP, moderate, %", anchor="middle", size=12, turned=True)
    return canvas
