"""Fixtures of commands."""

from tests.engines.made import answer  # noqa: F401
from tests.simulate.made_trees import six  # noqa: F401
