"""What a verdict calls the covariates and scales of its answers, for those who compute and those who draw."""

HUE_ANGLE = "hue angle"
"""Free curves alone run along it (`name.unexplained.TAKEN_UP`): a surface is of one hue, so that its level takes up
what follows the hue, and residuals show none of it."""
ALTERNATING = ("even rows", "even columns")
"""Receivers and emitters often work in two banks, in turn."""
CATEGORICAL = ("row", "class", *ALTERNATING)
"""Covariates whose values have no order."""
NAMED = {
    "step side": "step",
    "speed x time": "time",
    "hue": "rgb",
    HUE_ANGLE: "rgb",
    "even rows": "row",
    "even columns": "column",
}
"""What a verdict calls a covariate that is a finer look at another."""
SCALES = ("cells", "patches")
"""Scales of the contrast: a cell over the 3 x 3 about it; these over those farther about them (`model.contrast`). Each
class has one more scale, of its name: a cell over what the simulator says of its class at this angle and range."""
MAP_COLUMNS = 32
"""Columns of a residual map, before it is spread over the grid: rays are thinned to whole columns."""
