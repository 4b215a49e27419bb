"""How a command ends: every failure that is to be expected becomes one line and an exit code.

    0     done
    1     something that the user can mend; the line says what
    2     a command line that cannot be parsed (tyro's); instead of 1, of commands whose 1 is an answer (gates, watch)
    130   Ctrl-C, 143 SIGTERM: what was begun is saved or gone, and the same command goes on
    141   nobody reads what is written (`| head`)

Whatever else comes out is a fault of jaxsim's own, and keeps its traceback.
"""

from __future__ import annotations

import errno
import os
import sys
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from jaxsim.interrupts import Terminated, leave, terminable

STOPPED = "stopped; files that were finished stay, and the same command goes on with what is missing"
DAMAGE = (zlib.error, zipfile.BadZipFile, EOFError, RecursionError)
"""Errors of files that no reader has named: what the packages that unpack them raise."""
_REMEDIES = {
    errno.ENOSPC: "the disk is full; make room, and the same command goes on",
    errno.EDQUOT: "your quota of the disk is used up; make room, and the same command goes on",
    errno.EFBIG: "the file would be larger than the system allows (ulimit -f)",
    **dict.fromkeys((errno.EACCES, errno.EPERM), "you may not; mend its permissions, or name another place"),
    errno.EROFS: "it cannot be written to: the disk is read-only; name another place",
    errno.EEXIST: "it is there already, and is no folder; name another place",
    errno.ENOTDIR: "a part of the path is a file, not a folder; name another place",
    errno.EISDIR: "it is a folder; a file belongs there",
    errno.ENOENT: "there is no such file or folder",
    errno.ENAMETOOLONG: "the name is too long for this disk",
    errno.ELOOP: "it is a link that leads to itself",
    errno.EMFILE: "too many files are open (ulimit -n)",
}


@contextmanager
def stop_on_error(status: int = 1) -> Iterator[None]:
    """Ends the program with one line where a user can mend the cause (and this `status`), where it was interrupted, and
    quietly where nobody reads on. JAXSIM_TRACEBACK=1 shows where it came from."""
    try:
        with terminable():
            yield
    except BrokenPipeError:
        # Python flushes once more at its end: into nothing.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(141)
    except KeyboardInterrupt as stop:
        if os.environ.get("JAXSIM_TRACEBACK"):
            raise
        with suppress(OSError):  # stderr may be gone by now
            print(f"\n{str(stop) or STOPPED}", file=sys.stderr, flush=True)
        leave(143 if isinstance(stop, Terminated) else 130)
    except Exception as error:
        message = words_of(error)
        if message is None or os.environ.get("JAXSIM_TRACEBACK"):
            raise
        if status != 1:
            print(f"error: {message}", file=sys.stderr)
        sys.exit(f"error: {message}" if status == 1 else status)


def words_of(error: BaseException) -> str | None:
    """What a user is told of an error that is to be expected; None for any other."""
    if isinstance(error, OSError) and error.errno is not None:
        where = f"{error.filename}: " if error.filename is not None else ""
        return f"{where}{_REMEDIES.get(error.errno) or error.strerror}"
    if isinstance(error, UnicodeDecodeError):
        return f"a text is no {error.encoding}: {error}; save it as UTF-8"
    if isinstance(error, UnicodeEncodeError):
        at = max(error.start - 20, 0)
        return f"a name has letters that are no {error.encoding}: {error.object[at : error.end]!r}; name it otherwise"
    if isinstance(error, ValueError | OSError | ModuleNotFoundError):
        return str(error)
    of_path = error.__context__  # pathlib makes a RuntimeError of a link to itself, before Python 3.13
    if isinstance(error, RuntimeError) and isinstance(of_path, OSError) and of_path.errno == errno.ELOOP:
        return words_of(of_path)
    from jaxsim.files import first_line  # not before it is needed: `jaxsim --help` reads no file

    said = first_line(error)
    if isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error):
        return f"not enough memory ({said}); ask for less at once (--batch, --workers) or of smaller grids"
    if _has_no_device(error):
        return f"JAX starts no device ({said}); JAX_PLATFORMS=cpu needs none, jaxsim doctor tells what is set"
    if isinstance(error, DAMAGE):
        return f"a file is damaged ({type(error).__name__}: {said}); JAXSIM_TRACEBACK=1 shows where it is read"
    return None


def _has_no_device(error: BaseException) -> bool:
    """Whether JAX found nothing to compute on; of a platform whose plugin is missing it asserts so, without a word."""
    unsaid = isinstance(error, AssertionError) and not str(error) and bool(os.environ.get("JAX_PLATFORMS"))
    return unsaid or (isinstance(error, RuntimeError) and "Unable to initialize backend" in str(error))
