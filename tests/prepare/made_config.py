"""Preparation of a few inputs at a small size."""

from jaxsim.config import PrepareConfig

SHAPE = (2, 4, 6)


def config(*inputs, size=SHAPE[1:]):
    return PrepareConfig(inputs=inputs, network_size=size)
