"""PENet (Hu et al., ICRA 2021): the paper's depth completion, image and sparse depth to dense depth.

geometry.py layers.py    coordinates of the cells, and blocks that see them (C-CNN)
network.py cspn.py       both branches and their fusion, and DA-CSPN++
published.py completion.py    published weights; a frame's depth        training.py    its three stages
"""

from __future__ import annotations

from jaxsim.prepare.depth.penet.completion import NEAREST_M, Penet, check_crop, complete, open_penet, save_penet
from jaxsim.prepare.depth.penet.published import CONVERTERS, from_published, published_shapes, to_published

__all__ = [
    "CONVERTERS",
    "NEAREST_M",
    "Penet",
    "check_crop",
    "complete",
    "from_published",
    "open_penet",
    "published_shapes",
    "save_penet",
    "to_published",
]
