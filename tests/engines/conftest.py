"""Fixtures of engines."""

from tests.engines.made import answer  # noqa: F401
