"""The trees of KITTI's layout that detectors train on.

clouds   a frame's cloud: measured, of depth alone, or with the intensity of a trained sensor
plan     what a tree is to hold: frames, labels, how its clouds are made
trees    writing them: `export_trees` (`jaxsim export`)
"""
