"""What the published Pseudo-LiDAR program does otherwise than jaxsim, for tests against its clouds."""

import numpy as np
from jaxtyping import Float

from jaxsim.frame import Camera


def published_camera(projection: Float[np.ndarray, "3 4"], rect_from_velo: Float[np.ndarray, "4 4"]) -> Camera:
    """The camera of a KITTI P2 as the published program reads it: without P2[2, 3], the 2.7 mm that its depth lacks."""
    projection = np.asarray(projection, np.float64)
    shift = np.eye(4)
    shift[:2, 3] = projection[0, 3] / projection[0, 0], projection[1, 3] / projection[1, 1]
    cam_from_velo = shift @ np.asarray(rect_from_velo, np.float64)
    return Camera(projection[:, :3].astype(np.float32), cam_from_velo.astype(np.float32))
