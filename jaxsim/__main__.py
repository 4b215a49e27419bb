"""`python -m jaxsim COMMAND`, where a shell does not find `jaxsim`."""

from jaxsim.cli import main

main()
