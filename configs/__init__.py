"""Experiments: one file, one `experiment` value, and a docstring that says what it takes and scored."""
