"""Fixtures of trees."""

from tests.export.made_trees import six  # noqa: F401
