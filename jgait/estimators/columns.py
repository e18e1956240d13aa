"""The columns of tables of results: what they hold, their units, and how readers see them.

The name of a column is that of the quantity, then the unit: `stride_length_m`. The standard deviation of its error is
in a column of that name with `_std` before the unit, see `Column.deviation`.
"""

import math
from typing import NamedTuple

UNITS = {"m": "m", "cm": "cm", "s": "s", "mps": "m/s", "deg": "°", "pct": "%", "percent": "%", "spm": "steps/min"}
"""Unit at the end of the name of a column → the unit as readers see it."""


class Column(NamedTuple):
    """A column of a table of strides, of their summary or of bouts."""

    quantity: str  #: as in the name of the column.
    unit: str  #: one of `UNITS`, or "1" for a number without a unit in its name.
    words: str  #: the quantity in words.
    digits: int  #: decimal places that readers see, in their unit.
    cm: bool = False  #: whether readers see centimetres.
    summarised: bool = True  #: whether the table `summary` has a row of it.
    listed: bool = True  #: whether the page lists it stride by stride, and in its means.
    meaning: str = ""  #: what its name does not say.

    @property
    def name(self) -> str:
        """The name of the column."""
        return self.quantity if self.unit == "1" else f"{self.quantity}_{self.unit}"

    @property
    def deviation(self) -> str:
        """The name of the column with the standard deviation."""
        return f"{self.quantity}_std_{self.unit}"

    @property
    def shown(self) -> str:
        """The unit as readers see it."""
        return "cm" if self.cm else UNITS.get(self.unit, "")

    @property
    def scale(self) -> float:
        """Factor to that unit."""
        return 100.0 if self.cm else 1.0

    @property
    def heading(self) -> str:
        """Words and unit."""
        return f"{self.words} [{self.shown}]" if self.shown else self.words

    def text(self, value: float | None, deviation: float | None = None) -> str:
        """A value as readers see it, with its standard deviation if there is one, and the unit; "–" without a value."""
        if value is None or not math.isfinite(value):
            return "–"
        known = deviation is not None and math.isfinite(deviation) and deviation > 0.0
        spread = f" ± {self.scale * deviation:.{self.digits}f}" if known and deviation is not None else ""
        return f"{self.scale * value:z.{self.digits}f}{spread} {self.shown}".rstrip()


COLUMNS = {
    column.name: column
    for column in (
        Column("stride_length", "m", "stride length", 3, meaning="along the stride, in the plane of the ground"),
        Column("stride_duration", "s", "stride time", 2, meaning="from an initial contact to the next of the foot"),
        Column("cadence", "spm", "cadence", 0, meaning="120 s over the duration of a stride"),
        Column("walking_speed", "mps", "walking speed", 2),
        Column("step_length", "m", "step length", 3),
        Column("step_duration", "s", "step time", 2, meaning="from a contact of the other foot to that of the side"),
        Column("stance", "pct", "stance", 0, meaning="share of the stride with the foot on the ground"),
        Column("stride_width", "m", "stride width", 1, cm=True, meaning="between the feet, across the stride"),
        Column("stride_height", "m", "rise", 1, cm=True, summarised=False, meaning="gain of height in a stride"),
        Column("turn", "deg", "turn", 0, summarised=False),
        Column("lift", "m", "sensor's lift", 1, cm=True),
        Column("contact_angle", "deg", "foot angle at contact", 0),
        Column("push_off_angle", "deg", "foot angle at push-off", 0),
        *(
            Column(f"{joint}_flexion_{end}", "deg", words.format(joint), 0, listed=end != "range")
            for joint in ("hip", "knee")
            for end, words in (
                ("max", "largest {} flexion"),
                ("min", "smallest {} flexion"),
                ("range", "range of {} flexion"),
            )
        ),
        Column("distance", "m", "distance", 2, summarised=False, listed=False),
        Column("start", "s", "start", 1, summarised=False, listed=False),
        Column("duration", "s", "duration", 1, summarised=False, listed=False),
        Column("strides", "1", "strides", 0, summarised=False, listed=False),
        Column("n_strides", "1", "strides", 0, summarised=False, listed=False),
        Column("n_regular", "1", "regular", 0, summarised=False, listed=False, meaning="strides that count in medians"),
    )
}
"""Name of a column → the column."""

QUANTITIES = {column.quantity: column for column in COLUMNS.values()}
"""Name of a quantity → its column."""
