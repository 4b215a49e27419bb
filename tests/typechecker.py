"""The check of annotations at run time: beartype, to which an int is a float, as it is to type checkers (PEP 484)."""

from beartype import BeartypeConf, beartype

check = beartype(conf=BeartypeConf(is_pep484_tower=True))
