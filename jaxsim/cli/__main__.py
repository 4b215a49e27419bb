"""`python -m jaxsim.cli COMMAND`."""

from jaxsim.cli import main

main()
