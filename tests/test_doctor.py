"""Facts of a machine."""

import numpy as np
import pytest

from jaxsim import doctor
from jaxsim.doctor import check_needs, facts, installed_extras, module_of, requirements
from jaxsim.frame import Cloud


def test_facts_come_in_the_order_of_a_bug_report():
    names = [name for name, _ in facts()]
    assert names[:5] == ["jaxsim", "python", "system", "machine", "packages"]
    assert names[-2:] == ["cache", "extras"]


def test_the_form_of_sparse_convolutions_is_told(monkeypatch):
    monkeypatch.setenv("JAXSIM_NATIVE", "0")
    assert dict(facts())["native"] == "XLA (JAXSIM_NATIVE=0)"


def test_what_is_needed_and_what_is_extra_comes_from_the_package_itself():
    needs, extras = requirements()
    assert {"jax", "numpy"} <= {*needs}
    assert "torch" not in needs
    assert extras["convert"] == ["torch"]
    # jax itself is there without a GPU; what its own extra brings tells whether this one is.
    assert {"jax", "jax-cuda13-plugin"} <= {*extras["cuda"]}


def test_a_user_without_a_home_is_told_of_the_cache(monkeypatch, tmp_path):
    """As in a container that runs under a number."""

    def unknown(number):
        raise KeyError(number)

    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr("pwd.getpwuid", unknown)
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    assert doctor.cache() == [("cache", f"{tmp_path}: 0 files, 0 MiB")]


def test_an_extra_that_lacks_something_says_what():
    ((_, told),) = installed_extras({"here": ["numpy"], "gone": ["numpy", "no-such-package"]})
    assert told == "gone (lacks no-such-package); here"
    assert module_of("ouster-sdk") == "ouster"


def test_a_missing_need_is_an_error(monkeypatch):
    monkeypatch.setattr(doctor, "requirements", lambda: (["numpy", "no-such-package"], {}))
    with pytest.raises(ModuleNotFoundError, match="no-such-package missing"):
        check_needs()


@pytest.mark.long
def test_the_sample_run_refuses_a_cloud_that_cannot_be(monkeypatch):
    class Blind:
        def simulate(self, **_):
            return Cloud(xyz_m=np.zeros((2, 3), np.float32), intensity=np.zeros(2, np.float32), valid=np.zeros(2, bool))

    monkeypatch.setattr("jaxsim.load", lambda name: Blind(), raising=False)
    with pytest.raises(ValueError, match="the sample cloud has 0 points"):
        doctor.sample_run()
