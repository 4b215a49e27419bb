"""The statistical model: what a sensor is expected to say of simulated rays, and how likely what it said is.

Letters
    b, c, r   block (a frame, or a sector of one), column, row; i a ray, R_i its simulated `Rays` after all effects
    y_i       measured ln intensity; ln I_i the simulated one; d_i measured range, m; r_i the expected reading, m
    z         an effect's parameters, (value - neutral) / scale (`parameters`)
    n         noise: logarithms of scales s_, log odds of rates q_ (`noise.Noise`); one for all frames
    u         random effects: levels of reflectance and poses (`random_effects`); they follow from z and n

What a fit climbs, in z and n (`fit.Objective`; derivatives in `gradients`)

    L(z, n) = sum over fitted blocks (intensity_b + range_b + drop_b) - |z / sd_z|^2 / 2 - |n - n_0|^2 / 2 sd_n^2
                                   (of sparse z: - ln(1 + z^2 / 0.02^2) each)

Intensity (`likelihood.intensity_terms`), over rays that are compared (`evidence.Evidence.compared`)

    intensity_b = sum_i ln p(y_i) - cost(u_b)        e_i = y_i - ln I_i - level_i(u)
    p(y_i) = t4(e_i; v_i)                            Student-t, 4 degrees of freedom, squared scale v_i
             P(t4 below the weakest reading)         where the sensor reads 0
             sigmoid(1.6 e / sqrt v) / width         at a top that cuts readings off: all that is brighter piles up
    v_i = s_intensity^2 + s_normals^2 tan^2(incidence) + step^2 / 12 I^2 + known_i    sensor, normals, rounding, levels

Return and range: one mixture a ray, columns whole (`likelihood.return_terms`, `of_columns`)

    p(column) = (1 - g) prod_i p(ray_i) + g [no ray of it returned]                   column lost whole: g
    p(d_i)    = C clutter(d_i) + (1 - C) { G ghost(d_i) + (1 - G) [ K_i h(d_i) + B_i near(d_i) ] }    of a return
    p(none)   = (1 - C) (1 - G) (1 - K_i - B_i)
    K_i       = keep_i (1 - q_drop)                  surface's echo is reported; q_drop: smooth, edge, beside the sky
                q_false                              where the simulated ray hits nothing; another at edges
    B_i       = (1 - keep_i) q_switch (1 - q_drop)   at edges: it is lost, and a neighbour's reported in its place
    q_switch                                         a rate times the share of the four neighbours that hit anything
    h(d)      = (1 - M) surface(d) + M between(d)    M mixed pixels: even between the surface and the one beside it
                near(d) / 2 + 1 / 200 m              where the simulated ray hits nothing
    surface(d) = (1 - q_wide - q_switch) t4(d - r_i - shift_i(u); V_i)                 core
               + q_wide Cauchy(d - r_i - shift_i(u); 1 m)                              wide: far off; at edges half
                                                                                       even between 0 and r_i
               + q_switch near(d)                                                      at edges: a neighbour's echo
    near(d)   = mean over the neighbours that hit anything of N(d; range beside, 0.05 m + 2 %)
    V_i       = s_range^2 + s_aim^2 |d r / d rotation|^2 + s_edge^2 [edge] + known_i + scatter, rounding of effects
    ghost     = N(d; ghost range, s_range + 0.1 m);  clutter(d) ~ d^a exp(-d / scale) before the surface
    drop_b    = the same with every density of a range 1: which rays returned;  range_b = the rest - cost(pose_b)

g, C, G, M, keep, r, scatter come from effects (fields of `Rays`); without effects g = C = G = M = 0, keep = 1.

Random effects in closed form (`random_effects`; Laird & Ware 1982)

    level_i = x_i (beta + street_b) + surface_s(i) + strip_t(i)
    x_i     = 1 (gain), kinds of surfaces, sec^2(incidence) / 2, -tan(incidence) d ln density / d incidence (density
              among the rays of a row), three disagreements of normals (`Evidence.features`); the simulator's
              differences within classes, and where the sensor does not follow its contrast, beside cells and patches
              (`contrast`); of a noisy one its detail on bright and on dark surfaces, and levels over their trend
              (`simulator`)
    shift_i = what the block's pose moves range i by: 1 / range is linear in the pose on planes; an effect that moves
              the whole sensor moves r_i by the same slopes (`fit.rays_for`), and only costs tell the two apart
    beta is shared by the fitted blocks; street, surface, strip, pose are each block's own and pay their priors:
    cost(u) = street^2 / 2 sd^2 + surface^2 / 2 sd^2 + strip^2 / 2 sd^2;   cost(pose) = |pose / sd|^2 / 2
    At given weights the best u with its cost is, up to a constant, the marginal likelihood of a normal model: what
    acts like a pose or a level is not free.

Rounding (`likelihood.rounding_gain`): readings on a lattice gain ln(0.995 step / finest) each, others lose ln 0.005.
Power of echoes (`null_model`): ln power is uncertain by sqrt v_i and by what surfaces differ by (`log_power_sd`).

Alternation (`null_model.fit_null`): robust weights of the closed forms at the residuals (w = 5 / (4 + e^2 / v) / v),
then noise by L-BFGS-B, twice; noise once more. The weights then stay for all effects that are held against this null.

Priors and bounds, and where they are set
    z       scalars N(0, 3), entries of vectors N(0, 1); the effect's bounds       parameters.LOOSE, effects/catalogue
            entries that are mostly 0 (`Parameter.sparse`) Cauchy(0, 0.02)         parameters.SPARSE
            heights of free curves N(0, 1), of 0.15 nats, 0.02, 3 cm, 0.1 lost     covariates.CURVES
    n       N(n_0, 2), n_0 where the fit begins; bounds                            noise.NOISE_SD, START, MOST, LEAST
    beta    kinds 0.3 nats, held within 0.7                                evidence.CLASS_SD, random_effects.CLASS_MOST
            curvature 0.002; shift 0.002 rad^2                             evidence.CURVATURE_SD, SHIFT_SD
            share of disagreeing normals 1; gain free                   evidence.NORMALS_SD, GAIN_PRECISION
            share of detail 1, of differences within classes 0.15       simulator.DETAIL_SD, SLOPE_SD
    street  0.1 nats; strip 0.1                                            cast.STREET_SD, STRIP_SD
    surface object 0.2, patch of 6 m 0.15                                  cast.OBJECT_SD, PATCH_SD, PATCH_M
    pose    2 cm, 1 mrad an axis; moves a reading by 15 % at most          evidence.POSE_SD, random_effects.POSE_MOST
    power   of a surface like its class's, as firmly as by 5 rays          null_model.FEW
    tails   Student-t of 4 degrees; far off 1 m                            noise.DEGREES, likelihood._WIDE_M
    near    5 cm and 2 % of the range; ghosts 10 cm                        likelihood._EDGE_SD_M, _EDGE_PART, _GHOST_M
    top     readings within 1 % of it pile up, beyond it cost 10 nats      likelihood._PILE, _ABOVE_TOP
    rays between two surfaces of frames that are cast again: 3 %           cast.UNKNOWN_BETWEEN
    edges and planes, by bends of 3 % and 1 % of 1 / range                 Rules.edge_, plane_bend
    kinds without classes: level ground, albedo, height                    kinds.KNOT_QUANTILES, Rules.level_ground_rad
    which rays are compared; which lie on a lattice                        Rules.compared_, finest_step, lattice_
    which columns of which frames                                   cast.RAYS, CLOSER_RAYS, Rules.sectors
    noise that a simulator has: how it is told; how smooth surfaces are    noise_levels.QUANTILE, smooth.PLANE_MISFIT
    what of it the sensor has, too, and is none                            Rules.common_noise

A simulator with noise of its own: ln I_i and r_i are what it means (`simulator.meant`), known_i what noise leaves.

Order of imports: cast < noise_levels < own_noise < kinds < smooth < contrast < simulator < evidence < noise
< random_effects < likelihood < gradients < fit < null_model, which also has several effects in place and fits each
beside the others.
`parameters` and `minimum` import none of them.
"""
