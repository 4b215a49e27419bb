"""The console script: its help, its version, and what it imports."""

import subprocess
import sys

import pytest

from jaxsim.cli import COMMANDS, main

HEAVY = ("jax", "tyro", "cv2", "numpy", "tensorflow_datasets")

ENDLESS = """
from jaxsim.cli import stop_on_error
with stop_on_error():
    for _ in range(100_000):
        print("line")
"""


def modules_after(code: str) -> set[str]:
    """Names in sys.modules after a program of its own."""
    program = f"import sys\n{code}\nprint(*sys.modules)"
    return set(
        subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout.split()
    )


@pytest.mark.parametrize(
    "code", ["import jaxsim", "import jaxsim.cli", "from jaxsim.cli import main; main(['--help'])"]
)
def test_neither_the_package_nor_its_help_imports_jax_or_a_command(code: str):
    modules = modules_after(code)
    assert not modules & {*HEAVY}
    assert not modules & {f"jaxsim.cli.{command.home.split(':')[0]}" for command in COMMANDS.values()}


def test_the_flags_of_discover_import_nothing_that_answers():
    """Its help should not wait for what an answer needs."""
    assert not modules_after("import jaxsim.cli.discover") & {"jaxsim.discover", "jaxsim.report", "scipy.stats"}


def test_help_prints_a_line_a_command(capsys):
    main(["--help"])
    lines = capsys.readouterr().out.splitlines()
    for name, command in COMMANDS.items():
        assert [line.split(maxsplit=1) for line in lines if line.startswith(f"  {name} ")] == [[name, command.summary]]
    assert len(lines) < len(COMMANDS) + 8
    main([])
    assert capsys.readouterr().out.splitlines() == lines


def test_at_its_end_a_command_looks_for_no_garbage():
    """Among all that JAX made that takes its time."""
    told = "import atexit, gc; from jaxsim.cli import main; atexit.register(lambda: print(gc.get_freeze_count() > 0))"
    ended = [sys.executable, "-c", f"{told}; main(['--version'])"]
    assert subprocess.run(ended, check=True, capture_output=True, text=True).stdout.splitlines()[-1] == "True"


def test_a_name_that_no_file_could_tell_is_refused_before_any_work(tmp_path):
    place = tmp_path / "lat\udcfc"
    with pytest.raises(SystemExit, match=r"a name has letters that are no utf-8: .*lat\\udcfc'; name it otherwise"):
        main(["export", "--data.kind", "synthetic", "--frames", "0", "--out", str(place)])
    assert not place.exists()


def test_version_is_the_packages(capsys):
    main(["--version"])
    assert capsys.readouterr().out.split()[0] == "jaxsim"


def test_a_reader_that_stops_reading_ends_the_program_without_a_traceback():
    with subprocess.Popen([sys.executable, "-c", ENDLESS], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as writer:
        assert writer.stdout
        assert writer.stderr
        assert writer.stdout.readline() == b"line\n"
        writer.stdout.close()
        assert writer.stderr.read() == b""
    assert writer.returncode == 141
