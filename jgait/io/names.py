"""Recognise a lab's names of columns: "GyroThighR_x (deg/s)" is thigh_right_gyr_x in jgait."""

import difflib
import itertools
import re
import unicodedata
from collections.abc import Mapping, Sequence

from jgait.io.units import split_unit
from jgait.types import PLACEMENTS, RecordingError

KINDS = {
    "gyr": (
        "gyroscope", "gyroskop", "giroscopio", "gyro", "gyr", "giro", "angularvelocity", "angularrate", "angvel",
        "winkelgeschwindigkeit", "drehrate", "vitesseangulaire", "velocidadangular", "velocitaangolare",
    ),
    "acc": (
        "accelerometer", "acceleration", "accelerazione", "accel", "acc", "beschleunigung", "beschl", "aceleracion",
        "acelerometro", "acel",
    ),
}  # fmt: skip
"""Kind of signal → words for this kind, without accents; a word comes before those that it contains."""

TIMES = re.compile(
    r"(date|datum)?(time|timestamp|zeit|zeitstempel|uhrzeit|temps|tiempo|tempo|tijd)(s|ms|us|ns|min|h)?|t(ms|us|ns)?|seconds|millis|micros"
)
"""Words for the clock, perhaps with a unit."""

SHORT = {f"{word}{axis}": f"{kind}_{axis}"
         for word, kind in (("a", "acc"), ("gf", "acc"), ("g", "gyr"), ("w", "gyr")) for axis in "xyz"}  # fmt: skip
"""Short name of a column, in lower case → its channel; gF is an acceleration in g, a bare g only beside a is a rate."""

NOT_RAW = ("free", "linear", "user", "filtered")  # words for processed signals, as acceleration without gravity
CHANNELS = tuple(f"{kind}_{axis}" for kind in ("gyr", "acc") for axis in "xyz")  # the columns of one sensor

COLUMNS = frozenset({"time", "feet_range", *(f"{place}_{channel}" for place in PLACEMENTS for channel in CHANNELS)})
"""The columns that jgait reads."""

NUMBERED = re.compile(r"(?P<signal>.*?[^\W\d_])[ _.-]*(?P<number>\d+)(?P<rest>\s*[(\[{].*|_[^\d_].*|)")
"""Pattern of a signal with the number of its axis, and perhaps its unit."""

NOT_USED = "none"  # what a user states instead of a placement for a sensor that is to be left out
LONG_UNITS = {"min": 60.0, "h": 3600.0}
"""Unit of time that only the name of a column states → s."""

COUNTER = "packetcounter"  # name of a column that counts the samples, in lower case

WORDS = {
    "head": "head", "sternum": "sternum", "chest": "sternum", "lowerback": "lower_back", "lumbar": "lower_back",
    "back": "lower_back", "pelvis": "pelvis", "sacrum": "pelvis", "waist": "waist", "hip": "waist", "wrist": "wrist",
    "thigh": "thigh", "upperleg": "thigh", "femur": "thigh", "shank": "shank", "lowerleg": "shank", "tibia": "shank",
    "shin": "shank", "ankle": "ankle", "foot": "foot", "feet": "foot", "shoe": "foot", "instep": "foot",
    "calcn": "foot", "becken": "pelvis", "oberschenkel": "thigh", "unterschenkel": "shank", "schienbein": "shank",
    "knochel": "ankle", "sprunggelenk": "ankle", "fuss": "foot", "schuh": "foot", "bassin": "pelvis",
    "cuisse": "thigh", "jambe": "shank", "cheville": "ankle", "pied": "foot", "cintura": "waist", "muslo": "thigh",
    "pierna": "shank", "tobillo": "ankle", "kreuzbein": "pelvis", "sacro": "pelvis", "bacino": "pelvis",
    "coscia": "thigh", "gamba": "shank", "caviglia": "ankle", "piede": "foot", "bovenbeen": "thigh",
    "onderbeen": "shank", "enkel": "ankle", "voet": "foot", "forehead": "head",
    **dict.fromkeys(("upperback", "midback", "middleback", "upperarm", "forearm"), ""),
}  # fmt: skip
"""Words of measuring systems and languages for placements, without accents, "" for places that jgait does not know; the
longest one that is a word of the name, or several words of it, is used."""

SIDE_WORDS = {
    "right": ("right", "r", "rt", "re", "rechts", "droite", "droit", "derecha", "derecho", "destra", "destro", "dx"),
    "left": ("left", "l", "lt", "le", "li", "links", "gauche", "izquierda", "izquierdo", "sinistra", "sinistro", "sx"),
}
"""Side → words of a name that state it."""

SIDE_OF = {word: side for side, words in SIDE_WORDS.items() for word in words}  # word → the side that it states

PLACE = re.compile(
    r"\d*(?P<before>{sides})?(?P<word>{words})s?(?P<after>{sides})?(?:imu|sensor)?\d*".format(
        sides="|".join(sorted(SIDE_OF, key=len, reverse=True)), words="|".join(sorted(WORDS, key=len, reverse=True))
    )
)
"""Pattern of a placement that is written as one word, perhaps with its side, a number and what is worn there:
"rightfoot", "shankl", "hip2". "Chip1" and "barefoot" are none."""

CODES = {
    **{side[0] + kind[0]: f"{kind}_{side}" for kind in ("foot", "shank", "thigh") for side in ("right", "left")},
    "sa": "pelvis", "lb": "lower_back",
}  # fmt: skip
"""Codes of two letters at the end of a name ("LF" for the left foot, "walk_lb" for the lower back) → placement."""


WORD = r"(?<![A-Za-z])[Ll][45](?!\d)|[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+"
"""The words of a column's name; the vertebrae are one word, other numbers words of their own."""


def placement_of(label: str) -> str | None:
    """The placement of a sensor from its name, such as "LowerBack" or "tibia_r_imu"; None where the name has none."""
    label = _without_accents(label.strip())
    plain = label.lower().replace("-", "_").replace(" ", "_")
    if plain in PLACEMENTS:
        return plain
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", label)
    tokens = [token for token in re.split(r"[^a-z0-9]+", spaced.lower()) if token]
    spans = ("".join(tokens[i:j]) for i in range(len(tokens)) for j in range(i + 1, min(i + 3, len(tokens)) + 1))
    words = sorted(filter(None, map(PLACE.fullmatch, spans)), key=lambda match: len(match["word"]), reverse=True)
    sides = {SIDE_OF[token] for token in tokens if token in SIDE_OF}
    sides |= {SIDE_OF[side] for match in words for side in match.group("before", "after") if side}
    if not words and tokens and tokens[-1] in CODES:
        return CODES[tokens[-1]]
    if not words and any(token in ("l4", "l5") for token in tokens):  # vertebrae, as whole words: "trial5" is none
        return "lower_back"
    if not words or len(sides) > 1:
        return None
    place = WORDS[words[0]["word"]]
    if place in PLACEMENTS:
        return place
    return f"{place}_{next(iter(sides))}" if place and sides else None


def _without_accents(text: str) -> str:
    """Letters without accents, "ss" for the sharp s."""
    plain = unicodedata.normalize("NFKD", text.replace("ß", "ss"))
    return "".join(letter for letter in plain if not unicodedata.combining(letter))


def _plain(name: str) -> str:
    """A column's name without accents, without what is in brackets and without a unit at its end."""
    return re.sub(r"[(\[{].*?[)\]}]", " ", _without_accents(split_unit(name)[0]))


def _words(name: str) -> list[str]:
    """The words of a column's name, in lower case."""
    return [word.lower() for word in re.findall(WORD, _plain(name))]


def _signal(words: list[str]) -> tuple[str, list[str] | None] | None:
    """The channel, and the words beside it (None: they are not whole); None for words of no raw signal."""
    if not words or any(word in NOT_RAW for word in words):
        return None
    joined = "".join(words)
    if joined in SHORT:
        return SHORT[joined], []
    at = len(words) - 1 - (words[-1] in SIDE_OF)  # the axis ends the name, or stands before its side
    axis, rest = (words[at], words[:at] + words[at + 1 :]) if words[at] in ("x", "y", "z") else ("", words)
    joined = "".join(rest)
    for kind, synonyms in KINDS.items():
        for synonym in filter(joined.__contains__, synonyms):
            last = not axis and joined.endswith(tuple(f"{synonym}{letter}" for letter in "xyz"))
            stated = joined[-1] if last else axis
            if not stated:
                return None
            taken, spans = synonym + (stated if last else ""), itertools.combinations(range(len(rest) + 1), 2)
            beside = (rest[:i] + rest[j:] for i, j in spans if "".join(rest[i:j]) == taken)
            return f"{kind}_{stated}", next(beside, None)
    return None


def column_of(name: str) -> str | None:
    """`time`, <placement>_<gyr or acc>_<x, y or z>, or without a placement, of a lab's name such as "Gyro Thigh R X
    [deg/s]"; None where it is not recognised.
    """
    words = _words(name)
    if TIMES.fullmatch("".join(words)):
        return "time"
    signal = _signal(words)
    if signal is None or signal[1] is None:
        return None
    channel, rest = signal
    where = placement_of("_".join(rest)) if rest else None
    return f"{where}_{channel}" if where else None if rest else channel


def sensor_of(name: str) -> tuple[str, str] | None:
    """The lab's name of a sensor and the channel of a column: ("IMU1", "gyr_x") of "IMU1_gyr_x"; None for others."""
    plain = _plain(name)
    channel, rest = _signal([word.lower() for word in re.findall(WORD, plain)]) or ("", None)
    label = rest and re.search(r"[\W_]*".join(map(re.escape, rest)), plain, re.IGNORECASE)
    return (label[0], channel) if label else None


RATE_UNIT = re.compile(r"(deg|rad|°)\w*\s*(/|per)\s*s", re.IGNORECASE)
"""A unit of angular rates in the name of a column."""


def like_a_signal(name: str) -> bool:
    """Whether a column's name is that of a gyroscope's or an accelerometer's axis, at any place."""
    return _signal(_words(name)) is not None


def states(name: str, kind: str) -> bool:
    """Whether a word for a kind of signal is anywhere in a column's name."""
    plain = "".join(re.findall("[a-z]", _without_accents(name).lower()))
    return any(word in plain for word in KINDS[kind])


def lettered(names: Sequence[str]) -> list[str]:
    """Names of columns with x, y and z for axes that are only numbered, from 0 or from 1: "acc_1 [g]" is "acc_x [g]".
    More or fewer numbers of one signal are no axes.
    """
    numbered: dict[tuple[str, str], dict[int, int]] = {}
    for at, name in enumerate(names):
        match = NUMBERED.fullmatch(name)
        if match and not like_a_signal(name) and any(states(match["signal"], kind) for kind in KINDS):
            numbered.setdefault((match["signal"], match["rest"]), {})[int(match["number"])] = at
    result = list(names)
    for (signal, rest), columns in numbered.items():
        if sorted(columns) in ([0, 1, 2], [1, 2, 3]) and not like_a_signal(signal):
            for axis, number in zip("xyz", sorted(columns), strict=True):
                result[columns[number]] = f"{signal}_{axis}{rest}"
    return result


def unit_in_name(name: str) -> str | None:
    """The unit with which the name of a time column ends, but s: "Time (ms)", "time_us", "t [min]"; None for none."""
    for unit, words in (
        ("ms", "ms|msec|milliseconds"), ("us", "us|µs|μs|usec|microseconds"), ("ns", "ns|nanoseconds"),
        ("min", "min|minutes"), ("h", "h|hours"),
    ):  # fmt: skip
        if re.search(rf"(?:[^A-Za-z]|(?<=[a-z])(?=[MU])|(?i:^\s*time(?:stamp)?))(?i:{words})\W*$", name):
            return unit
    return None


def is_number(cell: str) -> bool:
    """Whether a cell holds a number, perhaps with a decimal comma."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _unclear(name: str, given: list[str]) -> bool:
    """Whether a column is a bare gx, gy or gz without an ax beside it: a rate, or an acceleration in g."""
    return re.fullmatch(r"\s*g[xyz]\s*", name, re.IGNORECASE) is not None and "ax" not in map(str.lower, given)


def recognised(given: list[str], renamed: list[str], placement: str | None) -> dict[int, str]:
    """Column → jgait's name, for columns with a lab's names; left out where two columns have the same jgait name."""
    names: dict[int, str] = {}
    for index, name in enumerate(given):
        known = None if renamed[index] in COLUMNS or _unclear(name, given) else column_of(name)
        if known in CHANNELS:
            known = None if placement is None else f"{placement}_{known}"
        if known is not None and known not in renamed:
            names[index] = known
    clocks = [index for index, known in names.items() if known == "time"]
    dates = [index for index in clocks if given[index].strip().lower().startswith("dat")]
    for index in dates if len(dates) < len(clocks) else ():  # a clock beside the date is finer
        del names[index]
    return {index: name for index, name in names.items() if list(names.values()).count(name) == 1}


def not_recognised(lacking: list[str], position: Mapping[str, int], given: list[str], name: str) -> RecordingError:
    """The error about columns that lack, or, where none does, about a table in which no column is that of a sensor;
    `position` is the number of each recognised column.
    """
    if sum(map(is_number, given)) > len(given) / 2:
        return RecordingError(f"{name} has no header: it begins with {_few(given)}; write names of its columns above")
    signals = {kind: [column for column in given if states(column, kind)] for kind in ("gyr", "acc")}
    if signals["acc"] and not signals["gyr"]:
        rates = [column for column in given if RATE_UNIT.search(column) or "omega" in column.lower()]
        hint = f"if {rates[0]!r} is its rate, call it <placement>_gyr_x" if rates else f"found {_few(signals['acc'])}"
        return RecordingError(f"{name} holds no gyroscope, which every method needs; {hint}")
    if not lacking and any(column_of(column) in CHANNELS and not _unclear(column, given) for column in given):
        return RecordingError(
            f"{name} lacks the place of its sensor: found {_few(given)}; for one sensor with bare names give its "
            "place, such as {argument}", argument="placement", value="waist",
        )  # fmt: skip
    known = {index for column, index in position.items() if column in COLUMNS}
    unknown = [column for index, column in enumerate(given) if index not in known]
    # the lab's own names of the other axes, with the letter of one that lacks
    spelt = {re.sub("[xyz](?=[^xyz]*$)", wanted[-1], given[index].lower()): wanted for wanted in lacking
             for column, index in position.items() if column[:-1] == wanted[:-1]}  # fmt: skip
    likely = spelt | {column: column for column in lacking or sorted(COLUMNS - {"time", "feet_range"})}
    near = {column: difflib.get_close_matches(column.strip().lower(), likely, 1, 0.8) for column in unknown}
    looks = [f"{column!r} looks like {likely[meant[0]]!r}" for column, meant in near.items() if meant][:3]
    hint = f"; {', '.join(looks)}: correct the header of the file" if looks else ""
    sensors = [parts[0] for column in unknown if (parts := sensor_of(column))]
    if lacking:
        rest = f"; columns not recognised: {_few([c for c in unknown if sensor_of(c)] or unknown)}" if unknown else ""
        expected = [f"{lacking[0][:-1]}{axis}" for axis in "xyz"]
        needs = "; a sensor needs its gyroscope" if len(lacking) == 3 and "_gyr_" in lacking[0] else ""
        return RecordingError(f"{name} lacks {', '.join(lacking)}{needs}{hint}; expected columns {expected}{rest}")
    strange = [sensor for sensor in sensors if not difflib.get_close_matches(sensor.lower(), PLACEMENTS, 1, 0.8)]
    named = "; io.read and the commands place sensors by {argument}" if strange and not hint else ""
    return RecordingError(
        f"{name} has no column that is recognised as a sensor's: found {_few(given)}{hint}; columns are named "
        f"<placement>_gyr_x to <placement>_acc_z, such as foot_left_gyr_x{named}",
        argument="placements" if named else "",
        value={strange[0]: "PLACE"} if named else "",
    )


def _few(names: list[str]) -> str:
    """The first four of some names, and how many more there are."""
    return ", ".join(map(repr, names[:4])) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def no_placement(text: str) -> str:
    """The words about a placement that jgait does not know, with the nearest one, or with all."""
    near = difflib.get_close_matches(text, PLACEMENTS, 1, 0.6)
    hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(PLACEMENTS)}"
    return f"there is no placement {text!r}; {hint}"
