"""A folder of simulated frames: OUT/polar, OUT/clouds, OUT/previews, and what they are made with.

OUT/simulation.json   the trained sensor, the data set and the seed
OUT/sensor.json       the effects that were added, where there are any
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from jaxsim.effects.chain import SensorModel
from jaxsim.files import claim


def claim_frames(out: Path, *, sensor: str, data: str, seed: int | None) -> None:
    """Claims `out` for frames of a trained sensor (its fingerprint), a kind of data set and a seed.

    The seed is None where nothing is left to chance. Raises ValueError where `out` holds frames of another making.
    """
    made = {"sensor": sensor, "data": data, "seed": seed}
    note = "sensor is the fingerprint of a trained one: another run has another, and the same run trained on"
    filled = _has_frames(out)
    claim(out / "simulation.json", made, by="simulate", text=json.dumps(made, indent=2), filled=filled, note=note)


def claim_effects(out: Path, effects_model: SensorModel | None) -> None:
    """Claims `out` for frames with these effects, which are kept in OUT/sensor.json; no model is no file.

    Raises ValueError where `out` holds frames with other effects.
    """
    path = out / "sensor.json"
    claim(
        path,
        _plain(effects_model),
        by="simulate",
        filled=_has_frames(out) or path.is_file(),
        read=lambda _: _plain(SensorModel.load(path)),
        unsaid=_plain(None),
    )
    if effects_model is not None and not path.is_file():
        effects_model.save(path)


def _has_frames(out: Path) -> bool:
    return any((out / "polar").glob("*.npz"))


def _plain(effects_model: SensorModel | None) -> dict[str, Any]:
    """Names and parameters of the effects, as in sensor.json but each by itself."""
    effects = effects_model.effects if effects_model else ()
    return {"effects": [name for name, _ in effects], "parameters": [dict(parameters) for _, parameters in effects]}
