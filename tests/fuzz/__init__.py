"""Damaged and strange files against every reader of jaxsim: `python -m tests.fuzz N SEED`.

    recordings.py, made.py   a reader each of data sets' files and of files that jaxsim itself writes, with a valid one
    mutations.py, texts.py   what becomes of a file: bytes, texts and JSON, arrays, the file itself
    judge.py                 which of eight columns an outcome falls into
    worker.py                reads in a process of its own, under limits of memory and time

Mutation i of a seed is the same on every machine and in any order.
"""
