"""Features of images for the Fréchet Inception distance, as the two published programs take them."""

from jaxsim.metrics.inception.extractor import (
    CONVERTERS,
    KINDS,
    Extractor,
    load_extractor,
    open_extractor,
    random_extractor,
)
from jaxsim.metrics.inception.network import WIDTHS

__all__ = ["CONVERTERS", "KINDS", "WIDTHS", "Extractor", "load_extractor", "open_extractor", "random_extractor"]
