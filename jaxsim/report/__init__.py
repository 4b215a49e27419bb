"""Pictures and tables, from plain results.

results                              JSON, Markdown and scores as files
gate                                 a gate's checks for CI
pictures, boxes                      rasters, clouds and boxes as pixels
canvas, charts, page                 drawings, charts and the parts of a page
scenes                               clouds that a page turns in 3D, and pages of them
detection, detected                  KITTI's scores of a detector; what it found in clouds
discovery, named, evidence, accounts, regimes, words   the report of a discovery
simulated                            simulated frames, beside what was measured
notebook                             what notebooks show of results, frames and clouds
"""

from jaxsim.report.boxes import detection_picture, draw_above, draw_on_image
from jaxsim.report.detection import detection_table, mean_table, write_detection
from jaxsim.report.discovery import write_answer, write_report
from jaxsim.report.pictures import (
    beside,
    depth_picture,
    draw_cloud,
    pair_picture,
    save_picture,
    simulated_picture,
    strip,
)
from jaxsim.report.results import (
    difference_table,
    list_scores,
    score_table,
    write_frechet,
    write_list,
    write_scores,
)
from jaxsim.report.scenes import cloud_with_boxes, compared_clouds, write_clouds
from jaxsim.report.words import verdict_sentence

__all__ = [
    "beside",
    "cloud_with_boxes",
    "compared_clouds",
    "depth_picture",
    "detection_picture",
    "detection_table",
    "difference_table",
    "draw_above",
    "draw_cloud",
    "draw_on_image",
    "list_scores",
    "mean_table",
    "pair_picture",
    "save_picture",
    "score_table",
    "simulated_picture",
    "strip",
    "verdict_sentence",
    "write_answer",
    "write_clouds",
    "write_detection",
    "write_frechet",
    "write_list",
    "write_report",
    "write_scores",
]
