"""Fixtures of sets of pairs."""

from tests.data.made_odometry import odometry_root  # noqa: F401
from tests.data.made_prepared_set import out  # noqa: F401
