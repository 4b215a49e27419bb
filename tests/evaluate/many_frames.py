"""`python -m tests.evaluate.many_frames SIMULATED MEASURED COMPARED`: what `jaxsim eval generation` takes for folders.

Prints how many frames they hold, how many scores came out, and the most memory that it took, in MB. With the word
`intensities` in place of COMPARED its last pass alone, which tells intensities by class, range and incidence.
"""

import sys
from pathlib import Path

from jaxsim.evaluate.generation import _tables, generation_scores, open_folder
from tests.programs import peak_mb

if __name__ == "__main__":
    folders = [open_folder(Path(word)) for word in sys.argv[1:3]]
    alone = sys.argv[3] == "intensities"
    scores = _tables(*folders)[:2] if alone else generation_scores(*folders, compared=int(sys.argv[3]))
    print(*(len(folder.names) for folder in folders), len(scores), peak_mb())
