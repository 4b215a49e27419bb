"""Fixtures of trainings."""

from tests.train.made_apart import runs  # noqa: F401
