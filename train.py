"""Trains an intensity network, a detector or depth completion: `python train.py [EXPERIMENT] [--flags]`.

EXPERIMENT is a file of configs/ (default: synthetic, the embedded world). Any field is a flag. The run goes to
runs/NAME; the same command again resumes it. `jaxsim train` is the same program; its loop is jaxsim/train/loop.py.
"""

import sys

from jaxsim.cli import main

if __name__ == "__main__":
    main(["train", *sys.argv[1:]])
