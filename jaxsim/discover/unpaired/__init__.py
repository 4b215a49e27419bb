"""Where simulation and measurement show different streets: their readings' laws are compared, not their rays.

workflow       the whole way
read           the rays of two folders, with covariates that a range image alone gives
law, columns   the law of a reading in normal equations; its columns, and those of effects
conditional    ln I given what both range images say, and the terms that may stand for an effect
select, refine which effect the measured side has; its parameters
lost           lost rays, and lattices
"""
