"""The check of annotations at run time: beartype, to which an int is a float, as it is to type checkers (PEP 484)."""

from random import Random

from beartype import BeartypeConf, beartype
from beartype._check.code import codemain

# beartype draws which item of a list it looks at. Drawn from Python's own state, a check in a worker's thread looks to
# hypothesis like a strategy of the test beside it that gives other data each time.
codemain.getrandbits = Random().getrandbits

check = beartype(conf=BeartypeConf(is_pep484_tower=True))
