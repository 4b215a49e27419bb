"""The table of the unpaired benchmark counts what can be told apart from what cannot."""

from benchmarks.blind.unpaired import summary


def row(effect: str, *answer: str, severity: float = 4.0, in_set: bool = False) -> dict:
    return {
        "kind": "single",
        "truth": [effect],
        "answer": list(answer),
        "verdict": "named" if answer else "none",
        "severity": severity,
        "level": "default",
        "named": bool(answer),
        "first_right": answer[:1] == (effect,),
        "in_set": in_set,
        "parameters": [],
    }


def test_effects_count_by_what_would_tell_them():
    rows = [
        row("beam_gain", "beam_gain", in_set=True),
        row("range_falloff", "near_range_overlap"),
        row("saturation"),
        row("motion_distortion", "beam_gain"),
    ]
    lines = summary(rows).splitlines()
    assert "| severity 4: right name first | 50 % (1 of 2; 9 to 91 %) |" in lines
    assert "| another name alone | 50 % (1 of 2; 9 to 91 %) |" in lines
    assert any(line.startswith("| effects that need classes") and "0 of 1" in line for line in lines)
    assert any(line.startswith("| effects that need the same streets") and "1 of 1" in line for line in lines)
    assert "| saturation | 4 | none |" in lines
