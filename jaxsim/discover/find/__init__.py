"""Find: which channel's residuals depend on which covariate."""
