"""MATLAB's files of version 5 to 7, read by SciPy once their structure is known to be whole.

SciPy believes the types, lengths and dimensions of a file: damaged ones can end the process. *Format*: MathWorks,
"MAT-File Format", version 5: elements of a tag (type and length) and content; an array is an element of elements.
"""

import enum
import math
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from jgait.io.files import check_size, library, reading
from jgait.types import RecordingError

EXPECTED = "a MATLAB file of version 5 to 7"
NUMBERS = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
"""Type of an element of numbers → bytes of one."""


class Type(enum.IntEnum):
    """Types of elements, by MathWorks' "MAT-File Format", table 1-1."""

    INT8, INT32, UINT32, MATRIX, COMPRESSED = 1, 5, 6, 14, 15


class Held(enum.IntEnum):
    """Classes of arrays beside those of numbers, 6 to 15, ibid., table 1-3; the opaque one is what MATLAB keeps beside
    the variables (strings, dates, tables), and is read within a struct or cell.
    """

    CELL, STRUCT, CHAR, OPAQUE = 1, 2, 4, 17


type Order = Literal["little", "big"]


def read_matlab(
    path: Path, needed: Sequence[str], perhaps: Sequence[str] = (), expected: str = "", **options: Any
) -> dict[str, Any]:
    """Variables of a file, by SciPy's `loadmat` with its options; those that are `perhaps` there may lack. Raises
    RecordingError if it is of another version or damaged, lacks a needed variable, or has one twice.
    """
    scipy_io = library("scipy.io", EXPECTED)
    with reading(path, EXPECTED):
        there = _variables(path)
        if lacking := [name for name in needed if name not in there]:
            others = ", ".join(filter(None, there)) or "none"
            what = expected or f"variables {', '.join(needed)}"
            raise RecordingError(f"{path.name} has no variable {lacking[0]!r}, but {others}; expected {what}")
        names = [name for name in (*needed, *perhaps) if name in there]
        if twice := [name for name in names if there.count(name) > 1]:
            hidden = "one of which hides the rest; save each alone"
            raise RecordingError(f"{path.name} has several variables {twice[0]!r}, {hidden}")
        content = scipy_io.loadmat(path, variable_names=names, **options)
        return {name: content[name] for name in names}


def _variables(path: Path) -> list[str]:
    """The names of the variables of a file that is whole; raises ValueError or RecordingError for a damaged one."""
    content = path.read_bytes()
    order: Order = "little" if content[126:128] == b"IM" else "big"
    if content.startswith(b"MATLAB 7.3"):
        how = "in MATLAB, load it and save(file, 'data', '-v7')"
        raise RecordingError(f"{path.name} is a MATLAB file of version 7.3; expected version 5 to 7: {how}")
    if 0 in content[:4] or content[126:128] not in (b"IM", b"MI") or int.from_bytes(content[124:126], order) != 0x100:
        raise ValueError("its header states another version")
    names, unpacked = [], 0
    for kind, element in _elements(memoryview(content)[128:], order):
        if kind == Type.COMPRESSED:
            unzip = zlib.decompressobj()
            tag = unzip.decompress(element, 8)
            size = int.from_bytes(tag[4:], order)
            unpacked += size
            check_size(unpacked, path)
            kind, element = (
                int.from_bytes(tag[:4], order),
                memoryview(unzip.decompress(unzip.unconsumed_tail, size + 1)),
            )
            if len(element) != size or not unzip.eof:
                raise ValueError(f"a variable of {size} bytes unpacks to {len(element)}")
        if kind != Type.MATRIX:
            raise ValueError(f"a variable is of type {kind}")
        names.append(_checked(element, order, 0))
    return names


def _elements(content: memoryview, order: Order) -> Iterator[tuple[int, memoryview]]:
    """Type and content of each element; ValueError where one is longer than what holds it."""
    at = 0
    while at < len(content):
        word, size = (int.from_bytes(content[at + k : at + k + 4], order) for k in (0, 4))
        kind, begin = word, at + 8
        if word >> 16:  # a short one, its length in the tag and its content in place of the length
            kind, size, begin = word & 0xFFFF, word >> 16, at + 4
        if begin + size > len(content) or (begin == at + 4 and size > 4):
            raise ValueError(f"an element of {size} bytes is longer than what holds it")
        yield kind, content[begin : begin + size]
        at = at + 8 if begin == at + 4 else begin + size + (0 if kind in (Type.MATRIX, Type.COMPRESSED) else -size % 8)


def _checked(content: memoryview, order: Order, depth: int) -> str:
    """The name of an array, once it and what it holds are checked; ValueError where it is damaged, or of a class that
    is not read. Such variables beside the others do no harm.
    """
    if not content:
        return ""
    (first, flags), *parts = _elements(content, order)
    if first != Type.UINT32 or len(flags) != 8:
        raise ValueError("an array has no flags")
    word = int.from_bytes(flags[:4], order)
    held, is_complex = word & 0xFF, bool(word & 0x800)
    kinds = [kind for kind, _ in parts]
    if held == Held.OPAQUE and depth and kinds == [Type.INT8, Type.INT8, Type.INT8, Type.MATRIX]:
        return _checked(parts[3][1], order, depth + 1)
    if held not in (Held.CELL, Held.STRUCT, Held.CHAR, *range(6, 16)):
        if depth:
            raise ValueError(f"an array is of the class {held}; expected structs, cells, texts and numbers")
        return ""
    if len(parts) < 2 or kinds[0] not in (Type.INT32, Type.UINT32) or depth > 50:
        raise ValueError("an array has no dimensions")
    shape, name = np.frombuffer(parts[0][1], f"{'<' if order == 'little' else '>'}i4").tolist(), parts[1][1]
    count = math.prod(shape)
    if not 2 <= len(shape) <= 32 or min(shape) < 0 or kinds[1] not in (Type.INT8, 2, 16):
        raise ValueError(f"an array has the dimensions {shape}")
    kinds, values = kinds[2:], [part for _, part in parts[2:]]
    if held in (Held.CELL, Held.STRUCT):
        if held == Held.STRUCT:
            length = (
                int.from_bytes(values[0], order) if kinds[:2] == [Type.INT32, Type.INT8] and len(values[0]) == 4 else 0
            )
            if not 1 <= length <= 1024 or len(values[1]) % length:
                raise ValueError("a struct has no names of fields")
            count *= len(values[1]) // length
            kinds, values = kinds[2:], values[2:]
        if len(kinds) != count or set(kinds) - {Type.MATRIX}:
            raise ValueError(f"an array of {count} arrays holds {len(kinds)} elements")
        for value in values:
            _checked(value, order, depth + 1)
        return bytes(name).decode("latin1")
    if held == Held.CHAR:
        whole = len(kinds) == 1 and kinds[0] in (1, 2, 3, 4, 16, 17, 18) and count <= (len(values[0]) or 1)
    else:
        whole = len(kinds) == 1 + is_complex and all(
            len(value) == count * NUMBERS.get(kind, 0) for kind, value in zip(kinds, values, strict=True)
        )
    if not whole or (set(kinds) - NUMBERS.keys() and held != Held.CHAR):
        raise ValueError(f"an array of {count} values holds {', '.join(map(str, map(len, values)))} bytes")
    return bytes(name).decode("latin1")
