"""The four stages of the whole way, in the order in which `workflow` runs them; each joins what the rooms hold.

place        the sensor where it stands, and what is left over once it stands there
ask          which effect is missing, by a closer look where need be
complete     what was named, all of it fitted together; laws for what has no name; what still repeats
conclude     the answer held against unseen scenes, as a verdict and as a sensor model
"""
