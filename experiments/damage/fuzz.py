"""Readers on files with seeded damage: each is read, or refused by a `RecordingError`, in bounded time and memory."""

import signal
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.common.row import Row, show
from experiments.damage.samples import Sample, samples
from jgait import RecordingError

EACH = 200
"""Damaged files of each format."""

LONGEST_S = 10.0
MEMORY, MEMORY_A_BYTE = 1e9, 20.0
"""[bytes] Largest growth of memory while any file is read, and more for each byte of it."""

LINE, OF = "damaged files that end otherwise than read or refused", "files"

CELLS = (b"1e999", b"-1e308", b"nan", b"", b"99999999999999999999", b"\xff\xfe", b'"', b"\0", b"\x1b[2J", b"{argument}")
WORDS = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF)
"""What replaces a cell of a text, and a number in a binary file."""


class Outcome(NamedTuple):
    """What a reader did with one damaged file: "read", "refused", "traceback", "hang" or "memory"; and details."""

    kind: str
    details: str


class Hang(BaseException):
    """A reader took too long."""


def damaged(content: bytes, draw: np.random.Generator) -> bytes:
    """The content with one to three kinds of damage."""
    data = bytearray(content)
    for _ in range(int(draw.integers(1, 4))):
        size = len(data)
        if not size:
            break
        begin = int(draw.integers(size))
        end = min(size, begin + int(draw.integers(1, 65)))
        match int(draw.integers(9 if b"\0" in content else 10)):  # a person rewrites tables alone
            case 0:
                for at in draw.integers(size, size=8):
                    data[at] ^= 1 << int(draw.integers(8))
            case 1:
                del data[begin:]
            case 2:
                del data[begin:end]
            case 3:
                data[begin:begin] = data[begin:end] * int(draw.integers(1, 50))
            case 4:
                data[begin:end] = bytes(end - begin)
            case 5:
                data[begin:begin] = draw.bytes(end - begin)
            case 6:
                width = int(draw.choice([1, 2, 4, 8]))
                word = WORDS[int(draw.integers(len(WORDS)))].to_bytes(8, "little")
                data[begin : begin + width] = word[:width]
            case 7:
                other = int(draw.integers(size))
                data[begin:end] = data[other : other + end - begin]
            case 8:
                cuts = [at for at, byte in enumerate(data) if byte in b",\t\n;: "] or [begin]
                first = int(draw.integers(len(cuts)))
                last = cuts[first + 1] if first + 1 < len(cuts) else size
                data[cuts[first] + 1 : last] = CELLS[int(draw.integers(len(CELLS)))]
            case 9:
                data = bytearray(rewritten(bytes(data), draw))
    return bytes(data)


def rewritten(text: bytes, draw: np.random.Generator) -> bytes:
    """A table as another program, or a person in an editor, would have written it."""
    lines = text.splitlines()
    row, separator = int(draw.integers(len(lines) or 1)), max((b",", b"\t", b";"), key=text.count)
    match int(draw.integers(9)):
        case 0:
            return text.replace(separator, (b",", b"\t", b";", b" ", b"  ")[int(draw.integers(5))])
        case 1:
            return text.replace(b".", b",") if separator == b"," else text.replace(b".", b",").replace(b"\t", b";")
        case 2:
            order = draw.permutation(max((line.count(separator) for line in lines), default=0) + 1)
            cells = [line.split(separator) for line in lines]
            lines = [separator.join(each[k] for k in order if k < len(each)) for each in cells]
        case 3:
            lines[row:row] = lines[int(draw.integers(len(lines) or 1)) :][: int(draw.integers(1, 9))]
        case 4:
            lines = [part for line in lines for part in ((line, b"") if draw.random() < 0.2 else (line,))]
        case 5:
            lines = [line for line in lines if draw.random() < 0.9]
        case 6:
            word = (b"NaN", b"n/a", b"-", b"#N/A", b"1e300", b"-9999", b"true", b"\xb5")[int(draw.integers(8))]
            cells = [[word if draw.random() < 0.02 else cell for cell in line.split(separator)] for line in lines]
            lines = [separator.join(each) for each in cells]
        case 7:
            lines = lines[: int(draw.integers(1, 5))]
        case 8:
            return text.decode("utf-8", "replace").encode("utf-16")
    return b"\r\n".join(lines) if draw.random() < 0.3 else b"\n".join(lines)


def variants(sample: Sample, number: int, seed: int) -> Iterator[dict[str, bytes]]:
    """Copies of a sample's files, in each of which one file is damaged."""
    draw = np.random.default_rng(seed)
    names = list(sample.files)
    for _ in range(number):
        # The main file is damaged in half of the copies, its companions in the others.
        name = sample.main if draw.random() < 0.5 else names[int(draw.integers(len(names)))]
        yield {**sample.files, name: damaged(sample.files[name], draw)}


def outcome(sample: Sample, files: dict[str, bytes], folder: Path) -> Outcome:
    """What the reader does with the files, written into an empty folder."""
    for name, content in files.items():
        (folder / name).write_bytes(content)

    def ring(*_: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, 1.5 * LONGEST_S)
    held, begin = _forget_peak(), time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            sample.read(folder / sample.main)
        result = Outcome("read", "")
    except RecordingError as error:
        text = str(error)
        fine = len(text) <= RecordingError.LONGEST and text.replace("\n", "").isprintable()
        result = Outcome("refused" if fine else "traceback", text)
    except Hang:
        return Outcome("hang", f"more than {1.5 * LONGEST_S} s")
    except Exception as error:
        result = Outcome("traceback", repr(error))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    seconds = time.perf_counter() - begin
    if seconds > LONGEST_S:
        return Outcome("hang", f"{seconds:.1f} s; {result}")
    grown = _memory("VmHWM") - held
    if grown > MEMORY + MEMORY_A_BYTE * sum(map(len, files.values())):
        return Outcome("memory", f"{grown / 1e9:.2f} GB; {result}")
    return result


def _forget_peak() -> float:
    """Memory [bytes] of this process; its peak counts from here."""
    clear = Path("/proc/self/clear_refs")
    if clear.exists():
        clear.write_text("5")
    return _memory("VmRSS")


def _memory(name: str) -> float:
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((1024.0 * int(line.split()[1]) for line in lines if line.startswith(name)), 0.0)


def outcomes(format: str, sample: Sample, number: int) -> list[Outcome]:
    """What the reader of a format does with some damaged files."""
    results = []
    for files in variants(sample, number, seed=sum(format.encode())):
        with tempfile.TemporaryDirectory() as name:
            results.append(outcome(sample, files, Path(name)))
    return results


def rows(quick: bool) -> list[Row]:
    """Damage every format."""
    counts: dict[str, list[Outcome]] = {}
    with tempfile.TemporaryDirectory() as name:
        for format, sample in samples(Path(name)).items():
            counts[format] = outcomes(format, sample, 10 if quick else EACH)
    kinds = ("read", "refused", "traceback", "hang", "memory")
    lines = [[format, *([one.kind for one in every].count(kind) for kind in kinds)] for format, every in counts.items()]
    show("damaged files", ["format", *kinds], lines)
    for format, every in counts.items():
        for one in every:
            if one.kind not in ("read", "refused"):
                print(f"{format}: {one.kind}: {one.details}")
    n = sum(map(len, counts.values()))
    of = {kind: sum(one.kind == kind for every in counts.values() for one in every) for kind in kinds}
    return [
        Row("fuzz_tracebacks", of["traceback"], "files", n=n, split="seeded damage of one file a format").on(
            LINE, "traceback", OF, simulated=True
        ),
        Row("fuzz_hangs", of["hang"], "files", n=n, split="more than 10 s").on(LINE, "over 10 s", OF, simulated=True),
        Row("fuzz_memory", of["memory"], "files", n=n, split="more than 1 GB and 20 bytes a byte of the file").on(
            LINE, "over 1 GB", OF, simulated=True
        ),
    ]
