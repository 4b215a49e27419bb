"""Where simulation and measurement show different streets: their readings' laws are compared, not their rays."""

from jaxsim.discover.unpaired.workflow import discover_unpaired

__all__ = ["discover_unpaired"]
