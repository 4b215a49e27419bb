"""Fixtures of commands."""

from tests.engines.made import answer  # noqa: F401
from tests.export.made_trees import six  # noqa: F401
