"""The embedded world: procedural streets, ray-cast for a camera and for a LiDAR whose physics is known.

    layout -> solids -> tiles -> raycast -> materials -> render -> true_sensor
    what      solids   which    what a     colour,     picture,  measured
    stands    with     solids   ray        905 nm      scan      cloud
    where     poses    a tile   meets
                       can see

Beside them: `things` (houses, trees, cars, people) and `palette` (their paints), `street` (the ground), `normals`
(where surfaces look), `light` (sun, sky, shadows), `fields` (noise that belongs to a place), `world`, the data set, and
`labelled`, its range images with classes.

`SyntheticWorld(seed)[i]` is a frame like any reader's; `.truth(i)` is what the sensor's rays met.
"""

from jaxsim.data.synthetic.true_sensor import TrueSensor, Truth, beam_gain
from jaxsim.data.synthetic.world import SyntheticWorld, cloud_of, kitti_camera

__all__ = ["SyntheticWorld", "TrueSensor", "Truth", "beam_gain", "cloud_of", "kitti_camera"]
