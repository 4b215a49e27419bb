"""Fixtures of sets of pairs."""

from tests.data.made_prepared_set import out  # noqa: F401
