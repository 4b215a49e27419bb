"""Learned intensity: pix2pixHD on (b, h, w, c) arrays. This stage knows nothing of LiDAR.

convolution, layers         padded convolutions; the block that both networks are made of, and its norms
networks, unet              generator and discriminators; a generator of the U-Net's form
losses, steps               GAN, features, VGG; everything that training changes, its step, and the trained generator
published                   the original program's checkpoints
"""

from jaxsim.pix2pix.losses import load_vgg
from jaxsim.pix2pix.published import start_from
from jaxsim.pix2pix.steps import create_state, make_generate, make_train_step, state_shapes

__all__ = ["create_state", "load_vgg", "make_generate", "make_train_step", "start_from", "state_shapes"]
