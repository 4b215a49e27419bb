"""Text and JSON that others wrote, read so that nothing is passed over in silence; errors that tell their place."""

from __future__ import annotations

import json
import math
import shlex
import sys
from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from types import GenericAlias
from typing import Any, NoReturn, TypeVar

from pydantic import TypeAdapter, ValidationError

from jaxsim.files.whole import check_size

MOST_TEXT = 256 * 2**20
"""Bytes of a text: grid.json of a million frames has 150 MB."""
Number = TypeVar("Number", int, float)
Settings = TypeVar("Settings")
Value = TypeVar("Value", bound=Hashable)


@contextmanager
def placed(where: str, *more: type[Exception], then: str = "") -> Iterator[None]:
    """A ValueError of the block, or an error of a kind among `more`, becomes one that begins with `where`, as
    `train: a.json`, and ends with `then`, what to do about it."""
    try:
        yield
    except (ValueError, *more) as error:
        raise ValueError(f"{where}: {words_of_wrong(error)}{then and f'; {then}'}") from error


def words_of_wrong(error: Exception) -> str:
    """What a file's reader found wrong, in words: of a KeyError Python says the key alone, and of values of another
    kind what cannot be done with them."""
    if isinstance(error, KeyError):
        return f"lacks {error}"
    return "a value is of another kind" if isinstance(error, TypeError | AttributeError) else str(error)


def first_line(error: BaseException) -> str:
    """The first line of an error's words, as far as a line of a message has room for it."""
    return (str(error).strip() or "no message").splitlines()[0][:200]


def as_argument(path: Path | str) -> str:
    """A path as an argument of a command that is there to be pasted: quoted where a shell would take it apart."""
    return shlex.quote(str(path))


def guess(name: str, known: Iterable[str]) -> str:
    """The end of a sentence on a name that is unknown: `; did you mean train?`, or a full stop where none is near."""
    near = get_close_matches(name, list(known), n=1)
    return f"; did you mean {near[0]}?" if near else "."


def repeated(values: Iterable[Value]) -> list[Value]:
    """The values that come more than once, each once."""
    return [value for value, times in Counter(values).items() if times > 1]


def read_names(path: Path, *, by: str) -> list[str]:
    """Frames of a list such as ImageSets/val.txt, one name a line. Raises ValueError for one that is named twice."""
    names = read_text(path, by=by).split()
    if twice := repeated(names):
        raise ValueError(f"{by}: {path} names {twice[0]} more than once; name each frame once")
    return names


def read_text(path: Path | str, *, by: str, most: int = MOST_TEXT, grows: bool = False) -> str:
    """A UTF-8 text without its byte order mark. Raises ValueError where it is none, with the line, where it holds
    bytes that are 0, as a file whose content was lost, and where it is too large. Of a text that `grows` such bytes at
    its end are left out: a machine that lost its power had made room for what was to come."""
    check_size(path, by=by, most=most)
    content = Path(path).read_bytes()
    if grows:
        content = content.rstrip(b"\0")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ValueError(
            f"{by}: {path}, line {line}: byte 0x{content[error.start]:02x} is no UTF-8; it must be plain text: copy it "
            "again, or save it as UTF-8"
        ) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise ValueError(
            f"{by}: {path}, line {line}: {text.count(chr(0))} of {len(content)} bytes are 0, which no text has: its "
            "content was lost, or it is UTF-16; copy it again, or save it as UTF-8"
        )
    return text


def parse_number(word: str, kind: type[Number], *, where: str) -> Number:
    """A number of a text, in digits of ASCII alone.

    Raises ValueError, beginning with `where`, for any other word, also for `1_0`, which Python takes for 10, and
    for whole numbers of more than 64 bits.
    """
    try:
        if "_" in word or not word.isascii():
            raise ValueError
        value = kind(word)
        if isinstance(value, int) and abs(value) >= 2**63:
            raise ValueError
        return value
    except ValueError:
        raise ValueError(f"{where}: {word[:40]!r} is no number") from None


def numbers(words: Iterable[str], *, where: str) -> list[float]:
    """Numbers of a text. Raises ValueError as `parse_number`."""
    return [parse_number(word, float, where=where) for word in words]


def real(value: Any) -> float:
    """A number of a JSON text. Raises ValueError for text and truth values, which Python would turn into one."""
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > sys.float_info.max:
        raise ValueError(f"{value!r:.60} is no number")
    return float(value)


def parse_json(content: str | bytes, *, finite: bool = True) -> Any:
    """What a JSON text holds. Raises ValueError where it is none, names a key twice, or is too deep to be read; for
    whole numbers of more than 64 bits; and, if `finite`, for NaN, for infinity, and for numbers that are too large to
    be told from it."""
    if not content.strip():
        raise ValueError("it is empty")
    hooks = {"parse_constant": _no_number, "parse_float": _finite} if finite else {}
    try:
        return json.loads(content, object_pairs_hook=_each_once, parse_int=_whole, **hooks)
    except RecursionError:
        raise ValueError("it holds values within values, deeper than can be read") from None


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number of JSON")


def _whole(digits: str) -> int:
    value = int(digits)
    if abs(value) >= 2**63:
        raise ValueError(f"{digits[:40]} is too large for a whole number")
    return value


def _finite(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise ValueError(f"{digits[:40]} is too large for a number")
    return value


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    entries = dict(pairs)
    if len(entries) < len(pairs):
        raise ValueError(f"{repeated(name for name, _ in pairs)[0]!r} is named twice")
    return entries


def read_json(path: Path | str, *, by: str, hint: str = "copy it again, or make it anew") -> Any:
    """What a JSON file holds; `hint` says what to do about one that is none. Raises ValueError as `parse_json`."""
    text = read_text(path, by=by)
    with placed(f"{by}: {path} is not JSON", then=hint):
        return parse_json(text)


def read_entry(path: Path | str, name: str, kind: type[Any] | GenericAlias, *, by: str) -> Any:
    """What a JSON file holds under one name, of the type `kind`, such as `list[str]`.

    Raises ValueError as `read_json`, and where it holds nothing under that name, or of another type.
    """
    content = read_json(path, by=by)
    with placed(f"{by}: {path} must hold {name!r}, a {kind}", KeyError, TypeError, then="remove it, or make it anew"):
        return parse_settings(kind, content[name])


def check_keys(given: Mapping[str, Any], known: Collection[str], *, where: str) -> None:
    """Raises ValueError for keys that mean nothing, which would be passed over; it names the nearest known ones."""
    unknown = [name for name in given if name not in known]
    if unknown:
        near = get_close_matches(unknown[0], known, n=1)
        guess = f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"
        raise ValueError(f"{where}: {unknown[0]!r} means nothing here; {guess}")


def parse_settings(kind: type[Settings] | GenericAlias, content: Any) -> Settings:
    """A dataclass of settings from the plain values of a JSON text.

    Types are taken as they are written (no "8" or true for a number), and keys must be known. Raises ValueError with
    the first value that is wrong, in a line.
    """
    adapter = TypeAdapter[Any](kind)  # type: ignore[arg-type]
    if is_dataclass(kind) and isinstance(content, Mapping):
        # Before it is said that the key is missing which one of these was to be.
        check_keys(content, [field.name for field in fields(kind)], where="settings")
    try:
        settings = adapter.validate_json(json.dumps(content), strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise ValueError(f"{where and f'{where}: '}{first['msg'].removeprefix('Value error, ')}") from error
    _check_tree(content, adapter.dump_python(settings, mode="json"))
    return settings


def _check_tree(given: Any, known: Any, place: str = "") -> None:
    """Raises ValueError for keys of `given` that `known`, a tree of the same form, has not."""
    if isinstance(given, Mapping) and isinstance(known, Mapping):
        check_keys(given, known, where=place or "settings")
        for key, value in given.items():
            _check_tree(value, known[key], f"{place}.{key}" if place else key)
    elif isinstance(given, list) and isinstance(known, list):
        for k, (one, other) in enumerate(zip(given, known, strict=False)):
            _check_tree(one, other, f"{place}[{k}]")
