"""How far a simulated frame is from the measured one."""

from jaxsim.metrics.baselines import GroupMeans, group_means
from jaxsim.metrics.paired import Score, paired_scores, paired_sums, ssim_map

__all__ = ["GroupMeans", "Score", "group_means", "paired_scores", "paired_sums", "ssim_map"]
