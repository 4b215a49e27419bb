"""Name: which effect of the catalogue is missing, or none, or something that the catalogue does not hold."""
