"""Pictures and tables, from plain results.

results                              JSON, Markdown and scores as files
gate                                 a gate's checks for CI
pictures, boxes                      rasters, clouds and boxes as pixels
canvas, charts, page, numbers        drawings, charts, the parts of a page, and how it writes numbers
scenes                               clouds that a page turns in 3D, and pages of them
detection, detected                  KITTI's scores of a detector; what it found in clouds
discovery, named, evidence, accounts, regimes, words   the report of a discovery
simulated                            simulated frames, beside what was measured
notebook                             what notebooks show of results, frames and clouds
"""
