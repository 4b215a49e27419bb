"""`jaxsim doctor` tells what a bug report needs."""

from jaxsim.cli import doctor
from jaxsim.cli.doctor import Doctor


def test_it_tells_versions_devices_cache_and_extras(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    (tmp_path / "program").write_bytes(bytes(2**20))
    Doctor(run=False)()
    told = dict(line.split(":", 1) for line in capsys.readouterr().out.splitlines())
    assert "cpu" in told["devices"]
    assert "jax 0." in told["packages"]
    assert "jaxlib 0." in told["packages"]
    assert "MISSING" not in told["packages"]
    assert "1 files, 1 MiB" in told["cache"]
    assert "sample run" not in told


def test_settings_are_told_where_no_device_starts(capsys, monkeypatch):
    def none():
        raise RuntimeError("Unable to initialize backend 'tpu'\nand more")

    monkeypatch.setattr("jax.devices", none)
    monkeypatch.setattr("jax.default_backend", none)
    monkeypatch.setenv("JAX_PLATFORMS", "tpu")
    Doctor(run=False)()
    told = dict(line.split(":", 1) for line in capsys.readouterr().out.splitlines())
    assert "none: JAX starts no device (Unable to initialize backend 'tpu'); JAX_PLATFORMS=cpu" in told["devices"]
    assert "JAX_PLATFORMS=tpu" in told["settings"]
    assert told["native"].strip() == "none: no device"


def test_the_sample_run_is_told_last(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "sample_run", lambda: "12 points simulated in 0.1 s")
    Doctor()()
    assert "sample run: 12 points" in capsys.readouterr().out
