"""Commands that are killed at random moments and started again: `python -m tests.kills N SEED`.

commands.py   the commands, small, and what of their results must come out the same
__main__.py   the kills, and full disks: a limit on the size of files stands for a disk without room
"""
