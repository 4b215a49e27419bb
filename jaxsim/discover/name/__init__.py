"""Name: which effect of the catalogue is missing, or none, or something that the catalogue does not hold.

starts         where fits begin that would feel no pull from elsewhere, read off the measurement
candidates     every effect, fitted and judged on scenes that its fit has not seen
select         one effect after another, as long as each gains more than the bar
unexplained    free curves, for what no effect describes
other_sides    the sides exchanged, and the control's frames: what is found there too is not said
each_class     what one class alone shows, or alone denies: it is not said, or another effect is asked
doubts         all that an effect is held to before it is said: the two above, and sizes that matter
null_draws     measurements in which nothing is missing, which set the bar
answer         which of the three answers it is
stepped        a step of all intensities in time
closer_look    more columns of the same frames, where the first look leaves effects undecided
look_alikes    what an effect of one's own looks like
simulator_contrast   whether the sensor follows the simulator's contrast, which a learned one gets wrong
"""
