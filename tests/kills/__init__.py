"""Commands that are killed at random moments and started again: `python -m tests.kills N SEED`.

commands.py   the commands, small, and what of their results must come out the same
process.py    a command at work, ended at a moment of its processor time
__main__.py   the attacks; of full disks a limit on the size of files stands for a disk without room
"""
