"""Frames to training pairs, made once and kept.

prepared   the pairs of a data set's frames, one file a frame in the cache, made as a training asks for them
sets       a set of pairs as TFDS files (`jaxsim prepare`), planned, made and put in place: `make_set`
shards     its files, made by worker processes, or by Apache Beam
"""
