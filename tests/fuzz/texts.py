"""Mutations of texts and of JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

import numpy as np

Rng = np.random.Generator
NUMBERS = (
    *("nan", "inf", "-inf", "1e30", "-1e30", "1e400", "1e-320", "-1", "0", "0.5", "1000000", "9" * 4300),
    *("1_0", "0x10", "", "true", "1,5", "١٢", "--3", "None"),
)
"""What may stand where a number should."""
VALUES: tuple[Any, ...] = (
    *(None, True, "text", "", "1", -1, 0, 1e30, 10**400, float("nan"), float("inf")),
    *([], {}, [[]], [None], {"a": 1}, [1, "a"], "../../x", "/etc/passwd"),
)
"""What may stand where another value should."""
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def _pick(rng: Rng, options: Any) -> Any:
    return options[int(rng.integers(0, len(options)))]


def _number(data: bytes, rng: Rng) -> bytes:
    found = list(_NUMBER.finditer(data))
    if not found:
        return data + b" 1"
    one = _pick(rng, found)
    return data[: one.start()] + _pick(rng, NUMBERS).encode() + data[one.end() :]


def _line_lost(data: bytes, rng: Rng) -> bytes:
    lines = data.split(b"\n")
    lines.pop(int(rng.integers(0, len(lines))))
    return b"\n".join(lines)


def _line_twice(data: bytes, rng: Rng) -> bytes:
    lines = data.split(b"\n")
    at = int(rng.integers(0, len(lines)))
    return b"\n".join([*lines[: at + 1], *lines[at:]])


def _word_lost(data: bytes, rng: Rng) -> bytes:
    words = data.split(b" ")
    words.pop(int(rng.integers(0, len(words))))
    return b" ".join(words)


def _words_swapped(data: bytes, rng: Rng) -> bytes:
    words = data.split(b" ")
    a, b = (int(k) for k in rng.integers(0, len(words), 2))
    words[a], words[b] = words[b], words[a]
    return b" ".join(words)


def _encoded(name: str) -> Callable[[bytes, Rng], bytes]:
    def encode(data: bytes, rng: Rng) -> bytes:
        return data.decode(errors="replace").encode(name, errors="replace")

    encode.__name__ = name
    return encode


def _latin(data: bytes, rng: Rng) -> bytes:
    """An umlaut as Latin-1 has it, somewhere."""
    at = int(rng.integers(0, len(data) + 1))
    return data[:at] + b"\xfc" + data[at:]


def _nul(data: bytes, rng: Rng) -> bytes:
    at = int(rng.integers(0, len(data) + 1))
    return data[:at] + b"\x00" + data[at:]


def _byte_order_mark(data: bytes, rng: Rng) -> bytes:
    return b"\xef\xbb\xbf" + data


def _windows_lines(data: bytes, rng: Rng) -> bytes:
    return data.replace(b"\n", b"\r\n")


def _old_mac_lines(data: bytes, rng: Rng) -> bytes:
    return data.replace(b"\n", b"\r")


def _long_line(data: bytes, rng: Rng) -> bytes:
    return b"a" * 1_000_000 + data


TEXT: tuple[Callable[[bytes, Rng], bytes], ...] = (
    _number,
    _number,
    _number,
    _line_lost,
    _line_twice,
    _word_lost,
    _words_swapped,
    _byte_order_mark,
    _windows_lines,
    _old_mac_lines,
    _encoded("utf-16"),
    _latin,
    _nul,
    _long_line,
)


def _paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Where values stand in a tree; of a long list the first few."""
    inner: list[Any] = []
    if isinstance(value, dict):
        inner = list(value.items())
    elif isinstance(value, list):
        inner = list(enumerate(value))[:4]
    return [path, *(p for key, one in inner for p in _paths(one, (*path, key)))]


def _changed(value: Any, path: tuple[Any, ...], change: Callable[[Any], Any]) -> Any:
    if not path:
        return change(value)
    out = value.copy()
    out[path[0]] = _changed(value[path[0]], path[1:], change)
    return out


def _of_tree(change: Callable[[Any, Rng], Any]) -> Callable[[bytes, Rng], bytes]:
    """A mutation of one value of a JSON text; of a file of several, of the last line."""

    def mutate(data: bytes, rng: Rng) -> bytes:
        head, text = b"", data.strip()
        try:
            tree = json.loads(text)
        except ValueError:
            head, _, text = text.rpartition(b"\n")
            tree, head = json.loads(text), head + b"\n"
        path = _pick(rng, _paths(tree))
        return head + json.dumps(_changed(tree, path, lambda value: change(value, rng))).encode()

    mutate.__name__ = change.__name__
    return mutate


def _other_value(value: Any, rng: Rng) -> Any:
    return _pick(rng, VALUES)


def _without(value: Any, rng: Rng) -> Any:
    """A dict without one of its keys, a list without one of its values."""
    if not isinstance(value, dict | list) or not value:
        return None
    chosen = int(rng.integers(0, len(value)))
    if isinstance(value, list):
        return value[:chosen] + value[chosen + 1 :]
    return {key: one for k, (key, one) in enumerate(value.items()) if k != chosen}


def _misspelt(value: Any, rng: Rng) -> Any:
    if not isinstance(value, dict) or not value:
        return {"unknown": value}
    chosen = int(rng.integers(0, len(value)))
    return {(key[::-1] + "x" if k == chosen else key): one for k, (key, one) in enumerate(value.items())}


def _deep(data: bytes, rng: Rng) -> bytes:
    return _pick(rng, (b"[" * 100_000, b'{"a":' * 100_000, b"[" * 100_000 + b"]" * 100_000))


def _deep_inside(data: bytes, rng: Rng) -> bytes:
    found = list(_NUMBER.finditer(data))
    if not found:
        return _deep(data, rng)
    one = _pick(rng, found)
    return data[: one.start()] + b"[" * 5000 + b"]" * 5000 + data[one.end() :]


def _other_tree(data: bytes, rng: Rng) -> bytes:
    return _pick(rng, (b"null", b"[]", b"{}", b"3", b'"text"', b"NaN", b"9" * 5000))


JSON: tuple[Callable[[bytes, Rng], bytes], ...] = (
    _of_tree(_other_value),
    _of_tree(_other_value),
    _of_tree(_other_value),
    _of_tree(_without),
    _of_tree(_misspelt),
    _of_tree(_misspelt),
    _deep,
    _deep_inside,
    _other_tree,
)
