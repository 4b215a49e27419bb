"""What `import jaxsim` offers."""

import pytest

import jaxsim


def test_every_public_name_is_there_and_an_unknown_one_answers_with_them():
    assert all(callable(getattr(jaxsim, name)) for name in jaxsim.__all__)
    with pytest.raises(AttributeError, match=r"no attribute 'simulate_all'; it has .*open_dataset"):
        _ = jaxsim.simulate_all


def test_public_names_are_listed_before_they_are_asked_for():
    assert dir(jaxsim) == sorted(jaxsim.__all__)
