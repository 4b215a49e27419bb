"""LIDIA (Vaksman, Elad, Milanfar, CVPR Workshops 2020): the paper's denoiser of intensity, a small network over
patches and their neighbours.

    search.py       the 14 patches most alike, at two scales; cells without return do not count
    layers.py network.py    the network, under its published names
    denoiser.py     whole images          intensity.py    LiDAR intensity
    published.py    published weights     adapt.py        training on images of one's own
"""

from __future__ import annotations

from jaxsim.prepare.denoise.lidia.denoiser import apply
from jaxsim.prepare.denoise.lidia.intensity import Lidia, open_lidia
from jaxsim.prepare.denoise.lidia.network import Variant
from jaxsim.prepare.denoise.lidia.published import CONVERTER, from_published, load_lidia, save_lidia, to_published

__all__ = [
    "CONVERTER",
    "Lidia",
    "Variant",
    "apply",
    "from_published",
    "load_lidia",
    "open_lidia",
    "save_lidia",
    "to_published",
]
