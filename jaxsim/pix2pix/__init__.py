"""Learned intensity: pix2pixHD on (b, h, w, c) arrays. This stage knows nothing of LiDAR."""

from jaxsim.pix2pix.losses import load_vgg
from jaxsim.pix2pix.published_files import start_from
from jaxsim.pix2pix.steps import create_state, make_generate, make_train_step, state_shapes

__all__ = ["create_state", "load_vgg", "make_generate", "make_train_step", "start_from", "state_shapes"]
