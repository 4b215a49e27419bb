"""Fixtures of trees."""

from tests.simulate.made_trees import six  # noqa: F401
