"""Code that files depend on."""

import pytest

from jaxsim.files import making, need


def test_a_missing_package_is_named_with_the_extra_that_brings_it():
    assert need("json", "none", by="test").dumps([]) == "[]"
    with pytest.raises(ModuleNotFoundError, match=r"test: .*no_such_package.*jaxsim-lidar\[extra\]"):
        need("no_such_package", "extra", by="test")


def test_what_other_settings_or_other_code_make_is_kept_apart():
    one = making("a", "frame.py")
    assert one == making("a", "frame.py")
    assert len({one, making("b", "frame.py"), making("a", "frame.py", "files")}) == 3
