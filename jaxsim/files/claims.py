"""A folder holds what was made one way: results of other settings are kept out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from jaxsim.files.texts import parse_json, parse_settings, read_text, words_of_wrong
from jaxsim.files.whole import replacing


def claim(
    record: Path,
    made: Mapping[str, Any],
    *,
    by: str,
    text: str | bytes | None = None,
    filled: bool | None = None,
    read: Callable[[bytes], Mapping[str, Any]] = parse_json,
    unsaid: Mapping[str, Any] | None = None,
    free: Collection[str] = (),
    note: str = "",
    instead: str = "another --out",
) -> None:
    """Claims the folder of `record` for what is made with the settings `made`; refuses it where it holds other things.

    `record` is the file that says what the folder was made with. `made` and what `read` takes from the record are
    plain JSON values by name, names within names dotted in what is told to the user; those in `free` may differ.
    `text` becomes the record's new content (None: the caller writes it). A folder that is not `filled` with results
    may change its settings; by default the record itself says that there are some. `unsaid` are the settings of a
    filled folder without a record, where it may lack one. `by` names the command in errors, `note` explains a
    setting that does not explain itself, `instead` says what to give for another folder.

    Raises ValueError, naming the settings that differ and what to do, where the folder holds what was made with
    others, where it holds results and no record, and where the record cannot be read.
    """
    folder, exists = record.parent, record.is_file()
    remedy = f"give {instead}, or delete the folder"
    if exists if filled is None else filled:
        was = unsaid
        if exists:
            try:
                was = read(read_text(record, by=by).encode())
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                wrong = words_of_wrong(error)
                message = wrong if str(record) in wrong else f"{by}: {record} cannot be read ({wrong}); copy it again"
                raise ValueError(f"{message}; or {remedy}") from error
        elif was is None:
            raise ValueError(f"{by}: {folder} is not empty, and no {record.name} says what it was made with; {remedy}")
        other = {name: values for name, *values in _changes(was, made, free=free)}
        if other:
            differences = "; ".join(_told(name, *values) for name, values in other.items())
            hints = [note] if note else []
            if any(isinstance(old, str) and Path(old).is_absolute() for old, _ in other.values()):
                hints.append(f"where a folder has only moved, write its new path into {record.name}")
            if free:
                hints.append(f"free to change are {', '.join(free)}")
            hint = f" ({'; '.join(hints)})" if hints else ""
            raise ValueError(f"{by}: {folder} was made with other settings ({differences}); {remedy}{hint}")
    if text is not None:
        with replacing(record) as path:
            path.write_bytes(text.encode() if isinstance(text, str) else text)


def claim_settings(
    record: Path, settings: Any, *, by: str, filled: bool | None = None, free: Collection[str] = ()
) -> None:
    """Claims the folder of `record` for what is made with a dataclass of settings, which the record keeps as JSON.

    The other arguments, and the ValueErrors that are raised, are those of `claim`.
    """
    adapter = TypeAdapter(type(settings))

    def plain(one: Any) -> Any:
        return adapter.dump_python(one, mode="json")

    claim(
        record,
        plain(settings),
        by=by,
        text=adapter.dump_json(settings, indent=1),
        filled=filled,
        read=lambda content: plain(parse_settings(type(settings), parse_json(content))),
        free=free,
    )


def differences(old: Any, new: Any, name: str = "", *, free: Collection[str] = ()) -> Iterator[str]:
    """In words, the settings in which two trees of plain values differ, but for those in `free`: `data.root was a, now
    b`."""
    yield from (_told(*change) for change in _changes(old, new, name, free=free))


def _changes(old: Any, new: Any, name: str = "", *, free: Collection[str] = ()) -> Iterator[tuple[str, Any, Any]]:
    """The dotted name of each leaf that differs, with its old and its new value; None where there was none."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in {**old, **new}:
            yield from _changes(old.get(key), new.get(key), f"{name}.{key}" if name else key, free=free)
    elif old != new and not _within(name, free):
        yield name, old, new


def _told(name: str, old: Any, new: Any) -> str:
    return f"{name} was {_brief(old)}, now {_brief(new)}"


def _brief(value: Any) -> str:
    """A value as text, what is long by its length and ends."""
    if isinstance(value, list | tuple) and len(value) > 8:
        return f"{len(value)} values ({value[0]} ... {value[-1]})"
    text = str(value) or "empty"
    return text if len(text) < 200 else f"{text[:80]} ... {text[-80:]}"


def _within(name: str, free: Collection[str]) -> bool:
    """Whether a setting, or one that holds it, is free to differ."""
    return any(name == outer or name.startswith(f"{outer}.") for outer in free)
