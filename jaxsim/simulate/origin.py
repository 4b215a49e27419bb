"""What made the frames of a folder: OUT/simulation.json, so that a resumed command adds no frames of another making."""

from __future__ import annotations

import json
from pathlib import Path

from jaxsim.files import replacing

MEANINGS = {
    "sensor": "another trained sensor (another run, or the same one trained on)",
    "data": "another data set",
    "seed": "another --seed",
}


def settle_origin(out: Path, *, sensor: str, data: str, seed: int | None) -> None:
    """Keeps what the frames of `out` are made from: fingerprint of the trained sensor, kind of data set, seed
    (None where nothing is left to chance).

    Raises ValueError where `out` holds frames of another making, or frames that do not say theirs.
    """
    path, now = out / "simulation.json", {"sensor": sensor, "data": data, "seed": seed}
    other = _differences(path, now) if any((out / "polar").glob("*.npz")) else []
    if other:
        raise ValueError(
            f"simulate: {out} holds frames made with {' and '.join(other)}, and they would stay as they are; "
            "give another --out, or delete the folder"
        )
    with replacing(path) as part:
        part.write_text(json.dumps(now, indent=2))


def _differences(path: Path, now: dict[str, object]) -> list[str]:
    """In words, what `path` says otherwise than `now`."""
    if not path.is_file():
        return ["something that left no simulation.json"]
    try:
        was = json.loads(path.read_text())
    except ValueError as error:
        raise ValueError(
            f"simulate: {path} is no readable JSON ({error}); give another --out, or delete the folder"
        ) from error
    return [meaning for key, meaning in MEANINGS.items() if was.get(key) != now[key]]
