"""Time that the checks of a camera's view take, of its size in KITTI.

python benchmarks/speed/rasters.py
"""

import numpy as np
from timing import interleave

from jaxsim.data.synthetic import kitti_camera
from jaxsim.frame import CLASSES, CameraFrame
from jaxsim.geometry.rasters import check_rasters, check_shapes

SIZE = (375, 1242)


def main() -> None:
    rng = np.random.default_rng(0)
    view = CameraFrame(
        rng.integers(0, 256, (*SIZE, 3), np.uint8),
        kitti_camera(),
        rng.uniform(3, 80, SIZE).astype(np.float32),
        rng.random(SIZE) < 0.8,
        rng.integers(0, CLASSES, SIZE, np.int32),
        rng.integers(0, 40, SIZE, np.int32),
    )
    interleave(
        "a view of 1242 x 375",
        {
            "shapes and types": lambda: check_shapes(view, "benchmark"),
            "values too": lambda: check_rasters(view, "benchmark"),
        },
    )


if __name__ == "__main__":
    main()
