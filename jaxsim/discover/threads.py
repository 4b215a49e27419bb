"""Linear algebra on one thread. Discovery solves many small systems between compiled programs that use all cores: two
pools of threads that wait by spinning take the cores from each other, several times over where others work beside."""

from threadpoolctl import threadpool_limits

one_blas_thread = threadpool_limits.wrap(limits=1, user_api="blas")
"""Decorator."""
