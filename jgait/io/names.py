"""Recognise a lab's names of columns: "GyroThighR_x (deg/s)" is thigh_right_gyr_x in jgait."""

import re
import unicodedata

from jgait.io.units import split_unit
from jgait.types import PLACEMENTS

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
    r"(date|datum)?(time|timestamp|zeit|zeitstempel|uhrzeit|temps|tiempo|tempo|tijd)(s|ms|us|ns|min|h)?|t(ms|us|ns)?|seconds"
)
"""Words for the clock, perhaps with a unit."""

NOT_RAW = ("free", "linear", "user", "filtered")
"""Words for processed signals, for example acceleration without gravity."""

CHANNELS = tuple(f"{kind}_{axis}" for kind in ("gyr", "acc") for axis in "xyz")
"""The columns of one sensor."""

COLUMNS = frozenset({"time", "feet_range", *(f"{place}_{channel}" for place in PLACEMENTS for channel in CHANNELS)})
"""The columns that jgait reads."""

LONG_UNITS = {"min": 60.0, "h": 3600.0}
"""Unit of time that only the name of a column states → s."""

COUNTER = "packetcounter"
"""Name of a column that counts the samples, in lower case."""

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
    "right": ("right", "r", "re", "rechts", "droite", "droit", "derecha", "derecho", "destra", "destro", "dx"),
    "left": ("left", "l", "le", "li", "links", "gauche", "izquierda", "izquierdo", "sinistra", "sinistro", "sx"),
}
"""Side → words of a name that state it."""

SIDE_OF = {word: side for side, words in SIDE_WORDS.items() for word in words}
"""Word → the side that it states."""

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

VERTEBRAE = ("l4", "l5")
"""Vertebrae by which the lower back is named ("L5 Gyr_X"), as whole words: "trial5" is none."""


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
    if not words and any(token in VERTEBRAE for token in tokens):
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


def _words(name: str) -> list[str]:
    """The words of a column's name without what is in brackets and without a unit at its end, in lower case."""
    plain = re.sub(r"[(\[{].*?[)\]}]", " ", _without_accents(split_unit(name)[0]))
    return [word.lower() for word in re.findall(WORD, plain)]


def _signal(words: list[str]) -> tuple[str, str, list[str] | None] | None:
    """Kind of signal, axis, and the words beside them (None: they are not whole); None for words of no raw signal."""
    if not words or any(word in NOT_RAW for word in words):
        return None
    axis, rest = (words[-1], words[:-1]) if words[-1] in ("x", "y", "z") else ("", words)
    joined = "".join(rest)
    for kind, synonyms in KINDS.items():
        for synonym in synonyms:
            if synonym not in joined:
                continue
            last = not axis and joined.endswith(tuple(f"{synonym}{letter}" for letter in "xyz"))
            stated_axis = joined[-1] if last else axis
            return (kind, stated_axis, _without(rest, synonym + (stated_axis if last else ""))) if stated_axis else None
    return None


def column_of(name: str) -> str | None:
    """The name of a column in jgait, or None where the lab's name, such as "Gyro Thigh R X [deg/s]", is not recognised.

    `time`, or <placement>_<gyr or acc>_<x, y or z>, or for a single sensor <gyr or acc>_<x, y or z>.
    """
    words = _words(name)
    if TIMES.fullmatch("".join(words)):
        return "time"
    signal = _signal(words)
    if signal is None or signal[2] is None:
        return None
    kind, axis, rest = signal
    where = placement_of("_".join(rest)) if rest else None
    return f"{where}_{kind}_{axis}" if where else None if rest else f"{kind}_{axis}"


def sensor_of(name: str) -> tuple[str, str] | None:
    """The lab's name of a sensor and the channel of a column: ("IMU1", "gyr_x") of "IMU1_gyr_x"; None for others."""
    plain = re.sub(r"[(\[{].*?[)\]}]", " ", _without_accents(split_unit(name)[0]))
    matches = list(re.finditer(WORD, plain))
    words = [match[0].lower() for match in matches]
    signal = _signal(words)
    kind, axis, rest = signal or ("", "", None)
    if not rest:
        return None
    begin = next((i for i in range(len(words)) if words[i : i + len(rest)] == rest), None)
    if begin is None:
        return None
    return plain[matches[begin].start() : matches[begin + len(rest) - 1].end()], f"{kind}_{axis}"


def like_a_signal(name: str) -> bool:
    """Whether a column's name is that of a gyroscope's or an accelerometer's axis, at any place."""
    return _signal(_words(name)) is not None


def states(name: str, kind: str) -> bool:
    """Whether a word for a kind of signal is anywhere in a column's name."""
    plain = "".join(re.findall("[a-z]", _without_accents(name).lower()))
    return any(word in plain for word in KINDS[kind])


def unit_in_name(name: str) -> str | None:
    """The unit with which the name of a time column ends, but s: "Time (ms)", "time_us", "t [min]"; None for none."""
    for unit, words in (
        ("ms", "ms|msec|milliseconds"), ("us", "us|µs|μs|usec|microseconds"), ("ns", "ns|nanoseconds"),
        ("min", "min|minutes"), ("h", "h|hours"),
    ):  # fmt: skip
        if re.search(rf"(?:[^A-Za-z]|(?<=[a-z])(?=[MU])|(?i:^\s*time(?:stamp)?))(?i:{words})\W*$", name):
            return unit
    return None


def _without(words: list[str], taken: str) -> list[str] | None:
    """The words without those whose concatenation is `taken`; None if `taken` is no concatenation of the words."""
    for first in range(len(words)):
        for end in range(first + 1, len(words) + 1):
            if "".join(words[first:end]) == taken:
                return words[:first] + words[end:]
    return None


def recognised(given: list[str], renamed: list[str], placement: str | None) -> dict[int, str]:
    """Column → jgait's name, for columns with a lab's names; left out where two columns have the same jgait name."""
    names: dict[int, str] = {}
    for index, name in enumerate(given):
        known = None if renamed[index] in COLUMNS else column_of(name)
        if known in CHANNELS:
            known = None if placement is None else f"{placement}_{known}"
        if known is not None and known not in renamed:
            names[index] = known
    clocks = [index for index, known in names.items() if known == "time"]
    dates = [index for index in clocks if given[index].strip().lower().startswith("dat")]
    for index in dates if len(dates) < len(clocks) else ():  # a clock beside the date is finer
        del names[index]
    return {index: name for index, name in names.items() if list(names.values()).count(name) == 1}
