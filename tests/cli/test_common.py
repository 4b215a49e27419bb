"""A reader that has seen enough."""

import subprocess
import sys

SCRIPT = """
from jaxsim.cli.common import stop_on_error
with stop_on_error():
    for _ in range(100_000):
        print("line")
"""


def test_a_reader_that_stops_reading_ends_the_program_without_a_traceback():
    with subprocess.Popen([sys.executable, "-c", SCRIPT], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as writer:
        assert writer.stdout
        assert writer.stderr
        assert writer.stdout.readline() == b"line\n"
        writer.stdout.close()
        assert writer.stderr.read() == b""
    assert writer.returncode == 141
