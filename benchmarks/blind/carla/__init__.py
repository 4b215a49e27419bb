"""CARLA's LiDARs without CARLA: streets of boxes, the published law of `sensor.lidar.ray_cast`, buffers byte by byte.

street      what rays hit: range, class, object, cosine of the incidence
law         the sensor's law with all its attributes, and those that a seed hides
buffers     `raw_data` and attributes.json, as a script on the server's side writes them

Nothing here imports jaxsim: it is what jaxsim is asked about.
"""
