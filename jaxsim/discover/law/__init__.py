"""What no effect of the catalogue describes, as a law of the sensor model: learned, and told as a formula.

In the order in which to read it:

    learn      a free curve (or a product of two) as knots and heights with their uncertainty
    search     the best of them for a learned law, in the units in which its covariates are told, by what groups of
               scenes say that its fit has not seen
    source     the formula as the file of an effect; a stranger's formula does not become code
"""
