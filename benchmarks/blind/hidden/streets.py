"""An unpaired case: the sensor's folder shows some streets, the simulator's others, on one grid."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, replace
from pathlib import Path

from benchmarks.blind.hidden.case import Key, _entropy, _write, key_path, look_at, make_setting, measure, plant, predict
from benchmarks.blind.hidden.catalogue import choose
from benchmarks.blind.hidden.nuisance import stream


def make_unpaired(
    folder: str | Path,
    *,
    effect: str | list[str] | tuple[str, ...] | None = "none",
    severity: float = 2.0,
    seed: int = 0,
    nuisance: str = "default",
    scenes: int = 16,
    frames: int = 1,
    rows: int = 48,
    columns: int = 384,
) -> Key:
    """Write FOLDER/measured, FOLDER/simulated and FOLDER.key.json, as `make_case` does, with other streets and other
    nuisances (wrong labels, noise on normals) on the simulated side; frame names and scenes say nothing of pairs.

    Raises:
        FileExistsError: the folder is there already.
        ValueError: an unknown name or level.
    """
    folder = Path(folder)
    if folder.exists() or key_path(folder).exists():
        raise FileExistsError(f"{folder} or its key is there already; give another folder")
    sizes = (scenes, frames, rows, columns)
    here, there = (_entropy(seed, effect, severity, nuisance, *sizes, side) for side in ("measured", "simulated"))
    setting = make_setting(here, nuisance, *sizes)
    other = replace(make_setting(there, nuisance, *sizes), grid=setting.grid)
    ideal = predict(setting)
    choice = choose(effect, stream(here, "choice"))
    plans, (effects, outside) = plant(choice, severity, setting, look_at(setting, ideal))
    expected = predict(other)
    for part, scene, simulated in (("measured", setting, ideal), ("simulated", other, expected)):
        whole = folder / ".both" / part
        _write(whole, scene, simulated, measure(scene, simulated, plans if part == "measured" else []))
        (whole / part).rename(folder / part)
    for rest in sorted((folder / ".both").rglob("*"), reverse=True):
        rest.rmdir() if rest.is_dir() else rest.unlink()
    (folder / ".both").rmdir()
    case = stream(here, "id").bytes(8).hex()
    key = Key(case, seed, severity, nuisance, effects, outside, setting.nuisance.as_dict(), time.time())
    key_path(folder).write_text(json.dumps(asdict(key), indent=1))
    return key
