"""Effects of one's own for tests: a file's text with what is to be wrong in it, and a catalogue that forgets them."""

import pytest

from jaxsim.effects import EFFECTS
from jaxsim.effects.own import TEMPLATE

LAW = 'brighten(rays, 4 * p["share"] * jnp.log(jnp.cos(rays.elevation_rad)))'
PARAMETER = 'Parameter(0.0, 0.0, 1.0, "", "share of the natural fall-off that is left", scale=0.3)'


def text_of(**changes):
    """The file that `jaxsim effects new` writes, with pieces of it replaced: law, parameter, or a field's line."""
    text = TEMPLATE.format(name="vignetting")
    for piece, new in changes.items():
        if piece in ("law", "parameter"):
            old = {"law": LAW, "parameter": PARAMETER}[piece]
            assert old in text
            text = text.replace(old, new)
        else:
            [line] = [line for line in text.splitlines() if line.startswith(f"    {piece}=")]
            text = text.replace(line, f"    {piece}={new}," if new else "")
    return text


def write(folder, **changes):
    path = folder / "vignetting.py"
    path.write_text(text_of(**changes))
    return path


@pytest.fixture
def forgetful(monkeypatch):
    """A catalogue that forgets what a test adds to it."""
    before = dict(EFFECTS)
    yield before
    EFFECTS.clear()
    EFFECTS.update(before)
