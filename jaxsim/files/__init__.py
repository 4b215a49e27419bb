"""Files: written whole or not at all, read by functions that check them, in folders that one process has at a time.

    whole.py    writing, listing and naming files; what a killed process left half written
    locks.py    keeping a folder for one process
    claims.py   keeping results of other settings out of a folder
    stamps.py   which files a frame is read from, and whether they have changed; reading once until they do
    texts.py    text, numbers and JSON; the place of an error that does not know it
    arrays.py   .npz files, with the SHA-256 of what they hold
    images.py   PNG and JPEG
    code.py     packages that only some files need, and the sources that made others

A file may be a stranger's: whatever is read is first measured, nothing in it is ever run or imported, and each reader
raises ValueError that names the file, says what is wrong and what to do. Files' names that come out of data pass
`file_of`.
"""

from jaxsim.files.arrays import array_names, digest, digest_of_values, read_arrays, write_arrays
from jaxsim.files.claims import claim, claim_settings, differences
from jaxsim.files.code import loaded, making, need
from jaxsim.files.images import check_image_file, image_of, read_pixels, write_image
from jaxsim.files.locks import lock, unlock, working_in
from jaxsim.files.stamps import (
    CHANGED,
    files_of,
    kept_files,
    read_once,
    sha256_of,
    stamp,
    stamp_of,
    tell_anew,
    why_anew,
)
from jaxsim.files.texts import (
    as_argument,
    check_keys,
    first_line,
    guess,
    numbers,
    parse_json,
    parse_number,
    parse_settings,
    placed,
    read_entry,
    read_json,
    read_names,
    read_text,
    real,
    repeated,
)
from jaxsim.files.whole import (
    check_apart,
    check_name,
    check_size,
    file_of,
    files_below,
    files_in,
    in_order,
    replacing,
    tidy,
    tidy_file,
    write_text,
)

__all__ = [
    "CHANGED",
    "array_names",
    "as_argument",
    "check_apart",
    "check_image_file",
    "check_keys",
    "check_name",
    "check_size",
    "claim",
    "claim_settings",
    "differences",
    "digest",
    "digest_of_values",
    "file_of",
    "files_below",
    "files_in",
    "files_of",
    "first_line",
    "guess",
    "image_of",
    "in_order",
    "kept_files",
    "loaded",
    "lock",
    "making",
    "need",
    "numbers",
    "parse_json",
    "parse_number",
    "parse_settings",
    "placed",
    "read_arrays",
    "read_entry",
    "read_json",
    "read_names",
    "read_once",
    "read_pixels",
    "read_text",
    "real",
    "repeated",
    "replacing",
    "sha256_of",
    "stamp",
    "stamp_of",
    "tell_anew",
    "tidy",
    "tidy_file",
    "unlock",
    "why_anew",
    "working_in",
    "write_arrays",
    "write_image",
    "write_text",
]
