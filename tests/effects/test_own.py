"""Effects of one's own join the catalogue, by a file or a package, and a sensor.json says where they come from."""

import hashlib
import subprocess
import sys

import pytest

from jaxsim.effects import EFFECTS, get_effect
from jaxsim.effects.origin import origin_of
from jaxsim.effects.own import known_effects, write_template
from jaxsim.effects.page import describe
from tests.effects.own import forgetful, text_of, write  # noqa: F401  (a fixture)

pytestmark = pytest.mark.usefixtures("forgetful")


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Installs a package whose module has this text, and which registers its EFFECT."""

    def install(text):
        site = tmp_path / "site"
        about = site / "acme_lidar-1.2.dist-info"
        about.mkdir(parents=True)
        (about / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-lidar\nVersion: 1.2\n")
        (about / "entry_points.txt").write_text("[jaxsim.effects]\nvignetting = acme_lidar:EFFECT\n")
        (site / "acme_lidar.py").write_text(text)
        monkeypatch.syspath_prepend(site)
        monkeypatch.delitem(sys.modules, "acme_lidar", raising=False)

    yield install
    sys.modules.pop("acme_lidar", None)


def test_the_file_that_is_written_to_begin_with_joins_at_the_end_of_its_stage(tmp_path):
    path = write_template("rain_on_lens", tmp_path / "rain_on_lens.py")
    known = list(known_effects([path]))
    assert list(EFFECTS) == known
    assert known[known.index("rain_on_lens") - 1] == "intensity_quantization"
    assert known[known.index("rain_on_lens") + 1] == "snr_dropout"
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    assert origin_of("rain_on_lens") == {"file": "rain_on_lens.py", "sha256": sha256}
    assert f"source: rain_on_lens.py, SHA-256 {sha256}" in describe(get_effect("rain_on_lens"))


@pytest.mark.parametrize(
    ("name", "why"), [("Rain", "no name"), ("class", "no name"), ("ünï", "no name"), ("beam_gain", "taken")]
)
def test_a_name_that_cannot_be_one_is_refused(tmp_path, name, why):
    with pytest.raises(ValueError, match=f"'{name}' is {why}"):
        write_template(name, tmp_path / "x.py")


def test_a_file_is_not_written_over(tmp_path):
    path = write_template("rain_on_lens", tmp_path / "mine.py")
    with pytest.raises(ValueError, match="is there already"):
        write_template("rain_on_lens", path)


def test_an_edited_file_is_another_effect_for_compiled_programs(tmp_path):
    known_effects([write(tmp_path)])
    first = get_effect("vignetting")
    known_effects([write(tmp_path, covariates='("row", "range")')])
    assert get_effect("vignetting") != first
    assert get_effect("vignetting").covariates == ("row", "range")


def test_a_package_registers_an_effect_by_an_entry_point(tmp_path, install):
    install(text_of())
    assert "vignetting" not in EFFECTS  # nobody asked yet
    known_effects()
    assert "source: package acme-lidar 1.2" in describe(get_effect("vignetting"))
    assert origin_of("vignetting") == {"package": "acme-lidar", "version": "1.2"}
    with pytest.raises(
        ValueError, match=r"two effects are named vignetting: from package acme-lidar 1.2, and from vig"
    ):
        known_effects([write(tmp_path)])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("import acme_lidar.more", r"cannot be loaded \(ModuleNotFoundError: .*mend or uninstall the package"),
        ("EFFECT = 'a text'", "gives str; it must be a jaxsim.effects.Effect"),
        (text_of(channels='("range",)'), "vignetting: apply changes the channel intensity"),
    ],
)
def test_a_package_that_is_broken_is_named(install, text, words):
    install(text)
    with pytest.raises(ValueError, match=f"entry point vignetting of package acme-lidar 1.2.*{words}"):
        known_effects()


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.txt", "", "no Python file .*a.txt; --effects-from takes a FILE.py"),
        ("a.py", None, "no file .*a.py"),
        ("a.py", "x = 1", "has no EFFECT; end it with EFFECT"),
        ("a.py", "EFFECT = 3", "gives int; it must be a"),
        ("a.py", "x = 1\n1 / 0", "a.py, line 2: ZeroDivisionError"),
        ("a.py", "raise SystemExit(3)", "a.py, line 1: SystemExit: 3"),
        ("a.py", "def", "a.py, line 1: SyntaxError"),
        (
            "a.py",
            "from jaxsim.effects import Effect\nEFFECT = Effect(name='a')",
            "line 2: TypeError: .* NAME` writes a file with",
        ),
    ],
)
def test_a_file_without_an_effect_is_refused(tmp_path, name, text, words):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=words):
        known_effects([tmp_path / name])


def test_importing_the_package_looks_at_no_entry_point():
    code = "import sys, jaxsim, jaxsim.effects, jaxsim.effects.chain; print('jaxsim.effects.own' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "False"
