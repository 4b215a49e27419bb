"""Compiling, keeping and loading the C++ form; whatever goes wrong leaves XLA's form and a line that says why."""

import logging
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest

from jaxsim.detect.sparse import CUBE, Sites, sparse_conv, submanifold_tables
from jaxsim.native import build

COMPILER = """#!/bin/sh
[ "$1" = --version ] && echo {version} && exit
echo "$@" >> {calls}
for given in "$@"; do
    [ "$given" = "{refused}" ] && echo "note: old" >&2 && echo "error: what is $given" >&2 && exit 1
done
while [ "$1" != -o ]; do shift; done
echo not a library > "$2"
"""


@pytest.fixture
def compiler(tmp_path, monkeypatch):
    """Makes a program stand for the compiler, which writes down how it is called; gives that file."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    calls = tmp_path / "calls"

    def make(refused="", version="1.0") -> Path:
        program = tmp_path / "compiler"
        program.write_text(COMPILER.format(calls=calls, refused=refused, version=version))
        program.chmod(0o755)
        monkeypatch.setenv("CXX", str(program))
        return calls

    return make


def kept(tmp_path):
    return sorted(path.name for path in (tmp_path / "jaxsim" / "native").iterdir())


def fallen_back(caplog):
    """What a process without a C++ form yet says of it, and that it says it in one line."""
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        form = build._loaded.__wrapped__()
    (line,) = caplog.messages
    assert form.startswith("XLA (")
    assert form.removeprefix("XLA ") in line
    return form


def test_it_is_compiled_once_for_this_processor_and_kept(compiler, tmp_path, caplog):
    calls = compiler()
    with caplog.at_level(logging.INFO):
        library = build.build()
        assert build.build() == library
    assert len(caplog.messages) == 1
    assert "compiling the C++ form" in caplog.messages[0]
    (call,) = calls.read_text().splitlines()
    assert "-march=native" in call
    assert jax.ffi.include_dir() in call
    assert kept(tmp_path) == [library.name]


def test_another_source_compiler_or_processor_has_its_own(compiler, tmp_path, monkeypatch):
    compiler()
    first = build.build()
    compiler(version="1.1")
    second = build.build()
    monkeypatch.setattr(build, "_processor", lambda: ["flags: fewer"])
    third = build.build()
    sources = tmp_path / "sources"
    sources.mkdir()
    for path in build.SOURCE.parent.iterdir():
        if path.suffix in (".cc", ".h"):
            (sources / path.name).write_text(path.read_text() + ("// more" if path.suffix == ".h" else ""))
    monkeypatch.setattr(build, "SOURCE", sources / build.SOURCE.name)
    assert len({first, second, third, build.build()}) == 4


def test_a_compiler_that_does_not_know_the_processor_compiles_for_its_kind(compiler):
    calls = compiler(refused="-march=native")
    build.build()
    assert ["-march=native" in call for call in calls.read_text().splitlines()] == [True, False]


def test_a_failing_compiler_leaves_xlas_form(compiler, tmp_path, caplog):
    compiler(refused="-O3")
    assert "compiler fails: error: what is -O3" in fallen_back(caplog)
    assert kept(tmp_path) == []


def test_a_library_that_does_not_load_leaves_xlas_form(compiler, caplog):
    compiler()
    assert ".so" in fallen_back(caplog)


def test_without_a_compiler_xlas_form_is_taken(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("CXX", "no-such-compiler")
    assert "no C++ compiler: no-such-compiler (CXX) not found" in fallen_back(caplog)
    monkeypatch.delenv("CXX")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "no C++ compiler: c++, g++, clang++ not found" in fallen_back(caplog)


def test_without_a_folder_to_keep_it_in_xlas_form_is_taken(compiler, monkeypatch, caplog):
    compiler()
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    assert "XDG_CACHE_HOME" in fallen_back(caplog)


def lowered():
    sites = Sites(jnp.arange(9, dtype=jnp.int32), (1, 3, 3))
    x, weights = jnp.ones((9, 2)), jnp.ones((*CUBE, 2, 2))
    return jax.jit(lambda x, w, s: sparse_conv(x, w, submanifold_tables(s))).lower(x, weights, sites).as_text()


def test_the_setting_and_other_devices_keep_xlas_form(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setenv(build.SETTING, "0")
        assert build.form() == "XLA (JAXSIM_NATIVE=0)"
        assert not build.available()
        assert "jaxsim_" not in lowered()
    monkeypatch.setattr(jax, "default_backend", lambda: "cuda")
    assert build.form() == "XLA (for cuda)"
    assert "jaxsim_" not in lowered()


def test_with_a_compiler_the_form_is_cpp():
    try:
        compiler = build.find_compiler()
    except FileNotFoundError as error:
        pytest.skip(str(error))
    assert build.form().startswith("C++ ("), f"{compiler} is here, but: {build.form()}"
    assert build.available()
    assert "@jaxsim_convolve" in lowered()
