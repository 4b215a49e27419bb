"""Pictures and tables, from plain results.

results                              JSON, Markdown and scores as files
pictures                             rasters, frames and clouds as pixels
canvas, charts, page                 drawings, charts, the parts of a page and its numbers
scenes                               clouds that a page turns in 3D, and pages of them
clouds                               simulated clouds beside measured ones, and those with what a detector found
detection                            KITTI's scores of a detector
discovery, named, evidence, accounts, regimes, words   the report of a discovery
gates                                what CI reads of a gate
notebook                             what notebooks show of results, frames and clouds
"""
