"""Where simulation and measurement show different streets: their readings' laws are compared, not their rays.

workflow       the whole way
read           the rays of two folders, with covariates that a range image alone gives
equations, columns the law of a reading in normal equations; its columns, and those of effects
conditional    ln I given what both range images say, and the terms that may stand for an effect
held_out       what a term gains on scenes that its fit has not seen
besides_ground whether more than the ground shows it
select, refine which effect the measured side has; its parameters
lost           lost rays, and lattices

What the law assumes, in nats unless said otherwise, and where it is set

    a scene's level 0.3, its slopes over ln r 0.2, incidence 0.3 a rad, height 0.1 a m    conditional.SCENE_SD
    patch of 4 m of ground 0.25                            columns.GROUND_PATCH_M, conditional.GROUND_PATCH_SD
    class 0.3; one of less than 1 % has no level           evidence.CLASS_SD, Rules.unpaired_rare_share
    curvature; free curve 0.15 a knot; gain free      conditional.LAW_CURVATURE_SD, CURVE_SD, columns.FREE_PRECISION
    coefficients of both sides' law: a ray's worth of pull             equations.LAW_PULL
    readings count within 3 robust standard deviations                 Rules.unpaired_held_sd
    parameters of effects as in the paired method                      columns.DERIVATIVE_STEP, parameters.LOOSE
    thresholds of the answer                                           Rules.unpaired_
"""
