"""Scores of what was learned and simulated; tables and pictures of them are `jaxsim.report`'s.

runs          a run whole: `score_learned_sensor`, `score_checkpoints` (`jaxsim eval RUN`)
intensity     predicted against measured intensity: cell by cell, with baselines, and by Fréchet distance
generation    two folders of frames or clouds that need share no names (`jaxsim eval generation`)
detector      a detector's scenes, what it finds, and KITTI's evaluation of that
cloud_folder  a folder of clouds for a detector, and the folder of what it finds (`jaxsim detect`)
"""
