"""Scores a trained run beside baselines, and more: `python eval.py ...` is `jaxsim eval ...`."""

import sys

from jaxsim.cli import main

if __name__ == "__main__":
    main(["eval", *sys.argv[1:]])
