"""Where simulation and measurement show different streets: their readings' laws are compared, not their rays."""
