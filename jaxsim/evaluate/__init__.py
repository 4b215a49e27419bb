"""Scores of runs: paired, between sets of clouds, FID, and a detector's average precision."""
