"""Hold a verdict against a key: names, sets, covariates, intervals. The only reader of keys."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind.hidden.case import Key, key_path
from benchmarks.blind.hidden.catalogue import EFFECTS

VERDICTS = ("named", "none", "not_in_catalogue")
ANGLES = ("azimuth_rad", "heading_rad")


def score(key: Key | dict[str, Any], verdict: dict[str, Any]) -> dict[str, Any]:
    """Right or wrong, part by part.

    Returns:
        case, kind ('none' | 'single' | 'combination' | 'outside'), truth, answer, and
        right: none -> verdict 'none'; single -> the right name first; combination -> exactly the hidden set;
            outside -> 'not_in_catalogue' with its channel and an acceptable covariate.
        named: an effect of the catalogue was claimed; first_right: the first name is hidden, or in `right` of a hidden
            one (where a renderer's law is none of the catalogue's); in_set: every hidden name is a claimed one or a
            look-alike of one; set_size: mean of 1 + look-alikes; exact; precision, recall, f1 of the claimed names;
            false_names: neither hidden nor in `right`;
        channel_right, covariate_right: of `unexplained` for outside cases, else None;
        where_right: one of the first five entries of `where` has a channel and an acceptable covariate of what is
            hidden (None where nothing is hidden, or it has no covariate);
        parameters: [{effect, parameter, truth, value, inside, relative_error}] of rightly named effects; `inside` is
            the share of a vector's entries within their intervals.

    Raises:
        ValueError: the verdict is not of the form that the design page gives.
    """
    key = asdict(key) if isinstance(key, Key) else key
    _check(verdict)
    truth = [e["name"] for e in key["effects"]]
    right = {name for e in key["effects"] for name in e.get("right", [e["name"]])}
    outside = key["outside"]
    kind = "outside" if outside else ("none", "single")[len(truth)] if len(truth) < 2 else "combination"
    claims = verdict["effects"] if verdict["verdict"] == "named" else []
    names = [c["name"] for c in claims]
    sets = [{c["name"], *c.get("look_alikes", [])} for c in claims]
    hits = len(set(names) & set(truth))
    covered = bool(truth) and all(any(t in s for s in sets) for t in truth)
    unexplained = verdict.get("unexplained") or {}
    out: dict[str, Any] = {
        "case": key["case"],
        "kind": kind,
        "truth": [f"outside:{outside['name']}"] if outside else truth,
        "severity": key["severity"],
        "level": key["level"],
        "verdict": verdict["verdict"],
        "answer": names,
        "named": bool(names),
        "first_right": bool(names) and names[0] in right,
        "in_set": covered,
        "set_size": float(np.mean([len(s) for s in sets])) if sets else None,
        "exact": set(names) == set(truth) and not outside,
        "precision": hits / len(set(names)) if names else None,
        "recall": hits / len(truth) if truth else None,
        "f1": 2 * hits / (len(set(names)) + len(truth)) if names or truth else None,
        "false_names": [n for n in names if n not in right],
        "channel_right": None,
        "covariate_right": None,
        "where_right": None,
        "parameters": _parameters(key["effects"], claims),
    }
    if outside:
        out["channel_right"] = unexplained.get("channel") == outside["channel"]
        out["covariate_right"] = bool(_words(unexplained.get("covariate")) & set(outside["covariates"]))
    places = [([outside["channel"]], outside["covariates"])] if outside else []
    places += [(e["channels"], e["covariates"]) for e in key["effects"] if e.get("covariates")]
    if places:
        out["where_right"] = any(
            w.get("channel") in channels and bool(_words(w.get("covariate")) & set(covariates))
            for w in verdict.get("where", [])[:5]
            for channels, covariates in places
        )
    out["right"] = {
        "none": verdict["verdict"] == "none",
        "single": out["first_right"],
        "combination": out["exact"],
        "outside": verdict["verdict"] == "not_in_catalogue" and out["channel_right"] and out["covariate_right"],
    }[kind]
    return out


def score_case(folder: str | Path, verdict_file: str | Path | None = None) -> dict[str, Any]:
    """Score FOLDER's verdict (FOLDER/out/verdict.json if no other is given) and write score.json beside it.

    Raises:
        FileNotFoundError: there is no key or no verdict.
        ValueError: the verdict is older than the case, or not of the right form.
    """
    folder = Path(folder)
    key_file = key_path(folder)
    verdict_file = Path(verdict_file) if verdict_file else folder / "out" / "verdict.json"
    if not key_file.exists():
        raise FileNotFoundError(
            f"no key at {key_file}; make the case first: python -m benchmarks.blind.hidden make {folder}"
        )
    if not verdict_file.exists():
        raise FileNotFoundError(f"no verdict at {verdict_file}; a case is scored after the answer is written")
    key = json.loads(key_file.read_text())
    if verdict_file.stat().st_mtime < key["made_at"]:
        raise ValueError(f"{verdict_file} is older than the case; let the finder answer this case and score again")
    result = score(key, json.loads(verdict_file.read_text()))
    (verdict_file.parent / "score.json").write_text(json.dumps(result, indent=1))
    return result


def describe(result: dict[str, Any]) -> str:
    """The score in a few lines for a terminal."""
    lines = [
        f"{'RIGHT' if result['right'] else 'WRONG'}: hidden {', '.join(result['truth']) or 'nothing'}"
        f" (severity {result['severity']:g}, {result['level']}); answer {result['verdict']}"
        f" {', '.join(result['answer'])}"
    ]
    if result["kind"] in ("single", "combination"):
        lines.append(
            f"  name first: {_yes(result['first_right'])}; in set: {_yes(result['in_set'])}"
            f" (mean size {result['set_size'] or 0:.1f}); exact set: {_yes(result['exact'])};"
            f" covariate: {_yes(result['where_right'])}"
        )
    if result["kind"] == "outside":
        lines.append(f"  channel: {_yes(result['channel_right'])}; covariate: {_yes(result['covariate_right'])}")
    for p in result["parameters"]:
        error = "" if p["relative_error"] is None else f", relative error {100 * p['relative_error']:.1f} %"
        inside = "no interval given" if p["inside"] is None else f"{100 * p['inside']:.0f} % inside the interval"
        lines.append(f"  {p['effect']}.{p['parameter']}: {inside}{error}")
    return "\n".join(lines)


def _yes(value: Any) -> str:
    return "yes" if value else "no"


def _words(covariate: str | list[str] | None) -> set[str]:
    """Covariates of an answer: a name, a list, or names joined as in 'row x range'."""
    parts = [covariate] if isinstance(covariate, str) else covariate or []
    return {w.strip().lower() for p in parts for w in p.replace("*", " x ").replace("×", " x ").split(" x ")}


def _check(verdict: dict[str, Any]) -> None:
    if not isinstance(verdict, dict) or verdict.get("verdict") not in VERDICTS:
        got = verdict.get("verdict") if isinstance(verdict, dict) else type(verdict).__name__
        raise ValueError(f"verdict is {got!r}; it must be an object whose 'verdict' is one of {', '.join(VERDICTS)}")
    effects = verdict.get("effects", [] if verdict["verdict"] != "named" else None)
    if not isinstance(effects, list) or (verdict["verdict"] == "named" and not effects):
        raise ValueError("verdict 'named' needs a list 'effects' with at least one entry")
    for e in effects:
        for name in [e.get("name"), *e.get("look_alikes", [])]:
            if name not in EFFECTS:
                raise ValueError(f"verdict names {name!r}; the catalogue has {', '.join(EFFECTS)}")


def _parameters(effects: list[dict[str, Any]], claims: list[dict[str, Any]]) -> list[dict[str, Any]]:
    out = []
    for effect in effects:
        claim = next((c for c in claims if c["name"] == effect["name"]), None)
        if claim is None:
            continue
        for name, truth in effect["parameters"].items():
            given = claim.get("parameters", {}).get(name)
            if given is not None:
                compared = _compare(effect["name"], name, truth, given)
                out.append({"effect": effect["name"], "parameter": name, **compared})
    return out


def _compare(effect: str, name: str, truth: Any, given: dict[str, Any]) -> dict[str, Any]:
    seen = np.array([t is not None for t in np.atleast_1d(np.array(truth, object))])
    t = np.array([np.nan if x is None else float(x) for x in np.atleast_1d(np.array(truth, object))])
    bounds = [np.ravel(np.asarray(given.get(k), float)) if given.get(k) is not None else None for k in
              ("value", "low", "high")]  # fmt: skip
    value, low, high = (None if b is None else np.broadcast_to(b, t.shape) if b.size == 1 else b for b in bounds)
    for b in (value, low, high):
        if b is not None and b.shape != t.shape:
            raise ValueError(f"{effect}.{name} has {b.size} entries in the verdict; the case has {t.size}")
    if value is not None and effect == "beam_gain":
        # The level of all gains is the global gain's; the key states gains of zero mean.
        level = value.mean()
        value, low, high = (None if b is None else b - level for b in (value, low, high))
    if value is not None and name in ANGLES:
        t = value + np.angle(np.exp(1j * (t - value)))
    inside = None
    if low is not None and high is not None:
        inside = float(np.mean(((t >= low) & (t <= high))[seen]))
    error = None
    if value is not None:
        rms = float(np.sqrt(np.mean(t[seen] ** 2)))
        scale = np.pi if name in ANGLES else max(rms, 1e-12)
        error = float(np.sqrt(np.mean((value - t)[seen] ** 2))) / scale
    return {"truth": truth, "value": given.get("value"), "inside": inside, "relative_error": error}
