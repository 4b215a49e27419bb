"""Find: where the two sides disagree, before anything is named.

other_surfaces   rays that meet a surface which one side alone has
division         find and judge scenes, and the null model that all that is found stands on
moments          from when on all intensities are brighter or darker
covariates       what a ray's disagreement may depend on; free curves along it, as laws
dependences      on which of them residuals do depend, given the others
correlation      whether intensities are related at all
levels           noise, losses and lattices of both sides
targets          points and brightness of single cars, signs and patches of road on both sides
"""
