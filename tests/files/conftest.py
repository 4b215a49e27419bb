"""Fixtures of data sets of files."""

from tests.data.made_odometry import odometry_root  # noqa: F401
