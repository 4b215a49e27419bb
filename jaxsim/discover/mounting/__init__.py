"""Mounting: where the sensor stands, from where the simulator has it; it is put in place before anything is named.

constant     off by the same in all frames: the effects of a mounting, with what they gain
change       off from a moment on, or in the frames of a tag: the sensor was knocked, or two cars recorded
per_frame    frames' own poses that scatter: each frame is put in place for itself
"""
