"""A walk in bouts: after each bout the feet stand side by side for a while, then the next bout begins there.

The plans of the bouts are joined into one plan on the host, so that the readings of the sensors, with their errors, and
the reference go on over the breaks.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray, PyTree

from jgait.simulate.check import check_sensors, check_values
from jgait.simulate.footsteps import FIRST, Plan
from jgait.simulate.person import Person
from jgait.simulate.recorded import planned_walk, room, simulated
from jgait.simulate.routes import Route, total_length
from jgait.simulate.sensors import IDEAL, ImuErrors
from jgait.simulate.worn import SEVEN, Truth
from jgait.types import Recording, as_float

CURVES = tuple(name for name in Plan._fields if name.endswith("_curve"))
"""Fields of a plan with coefficients for each interval."""

NUMBERS = tuple(name for name in Plan._fields if name not in (*CURVES, "end", "shape"))
"""Fields of a plan with a number for each foothold; `dip` has one for each interval."""


def with_breaks(
    key: PRNGKeyArray, person: Person, along: Sequence[Route], breaks: Sequence[float], errors: ImuErrors = IDEAL,
    rate: float = 100.0, *, placements: Sequence[str] = SEVEN,
) -> tuple[Recording, Truth]:  # fmt: skip
    """Simulate a walk in bouts with standing breaks between them, and return records of the library.

    `along` has the route of each bout, from where the bout before ended, in the direction in which it ended; `breaks`
    the times of standing between a bout and the next [s], one less than bouts. The number of steps of a bout is that
    which covers its route best, not `Gait.steps`. Other arguments as of `recording`.

    Returns:
        The recording, and the truth at the same times, in NumPy arrays; the first stride of a bout begins when its foot
        leaves the ground.

    Raises:
        TypeError, ValueError: as `recording`; if the numbers of routes and breaks do not fit, a break is not positive,
            or a bout begins on another slope than that on which the one before ended.
    """
    if not (len(along) == len(breaks) + 1 and all(0.0 < seconds < np.inf for seconds in breaks)):
        raise ValueError(f"bouts need a route each, and a positive break between two; got {len(along)}, {breaks}")
    check_values(person)
    check_sensors(errors, rate, placements)
    laid: Plan | None = None
    last = 0.0
    for number, way in enumerate(along):
        steps = max(1, round(float(total_length(way)) / (0.5 * float(person.gait.stride_length))))
        gait = person.gait._replace(steps=float(steps))
        if laid is not None:  # the other foot than the one that came last to stand beside it
            first = float(np.asarray(laid.side)[round(float(laid.end)) - 2 + FIRST])
            gait = gait._replace(right_first=1.0 if first < 0.0 else 0.0)
        bout = Person(person.body, gait)
        made, lasts = planned_walk(jax.random.fold_in(key, number), bout, way, f"on the route of bout {number + 1}")
        if laid is not None:
            slopes = float(laid.slope[round(float(laid.end)) + FIRST]), float(made.slope[0])
            if abs(slopes[0] - slopes[1]) > 1e-6:
                raise ValueError(
                    f"bout {number + 1} must begin on the slope on which the one before ended, "
                    f"{np.tan(slopes[0]):.3g}; it begins on {np.tan(slopes[1]):.3g}"
                )
        laid = made if laid is None else joined(laid, made, breaks[number - 1])
        last += lasts if number == 0 else lasts - float(gait.quiet_before + gait.quiet_after) + breaks[number - 1]
    assert laid is not None
    worn, true = simulated(key, person, padded(laid), last, errors, rate, placements)
    return Recording(worn, rate, "simulated", "simulated"), true


def joined(first: Plan, then: Plan, seconds: float) -> Plan:
    """The plan of two bouts with a break [s] between them; on the host.

    The second one is moved to where the first one ends. Its first foothold is taken when the first bout ends, and is
    the place where that foot stands; the break is the interval to its second foothold.
    """
    earlier, later = (jax.tree.map(as_float, plan) for plan in (first, then))
    count = round(float(earlier.end)) + FIRST  # footholds of the first bout, up to the closing step
    ends = {name: float(np.sum(getattr(earlier, name)[count - 1])) for name in CURVES}
    begins = {name: float(getattr(later, name)[FIRST, 0]) for name in CURVES}
    turn = ends["heading_curve"] - begins["heading_curve"]
    c, s = np.cos(turn), np.sin(turn)
    moved = {name: getattr(later, name).copy() for name in (*NUMBERS, *CURVES)}
    for x, y in (("x", "y"), ("x_curve", "y_curve")):
        moved[x], moved[y] = c * moved[x] - s * moved[y], s * moved[x] + c * moved[y]
    at = {"x": c * begins["x_curve"] - s * begins["y_curve"], "y": s * begins["x_curve"] + c * begins["y_curve"]}
    offsets = {f"{axis}_curve": ends[f"{axis}_curve"] - at[axis] for axis in "xy"}
    offsets |= {name: ends[name] - begins[name] for name in ("z_curve", "heading_curve", "distance_curve")}
    offsets["time_curve"] = ends["time_curve"] + seconds - begins["time_curve"]
    for name, offset in offsets.items():
        moved[name][:, 0] += offset
        moved[name][0] = 0.0
        moved[name][0, 0] = moved[name][FIRST, 0]  # held in the break
    moved["walking_curve"][0] = 0.0
    moved["time_curve"][0, :2] = ends["time_curve"], seconds
    for name, curve in (("x", "x_curve"), ("y", "y_curve"), ("z", "z_curve"), ("foot_yaw", "heading_curve")):
        moved[name] += offsets[curve]
    moved["contact"] += offsets["time_curve"]
    moved["contact"][0] = ends["time_curve"]
    both = {name: np.concatenate([getattr(earlier, name)[:count], values]) for name, values in moved.items()}
    return earlier._replace(**both, end=later.end + count)


def padded(laid: Plan) -> Plan:
    """The plan with as many footholds as plans of single walks have, so that both use the same programs."""
    more = room(len(laid.x) - 4) + 4 - len(laid.x)
    arrays: dict[str, PyTree] = {name: np.pad(getattr(laid, name), (0, more), mode="edge") for name in NUMBERS}
    arrays["contact"] = arrays["contact"] + np.maximum(np.arange(len(laid.x) + more) - len(laid.x) + 1.0, 0.0)
    arrays |= {name: np.pad(getattr(laid, name), ((0, more), (0, 0)), mode="edge") for name in CURVES}
    return jax.tree.map(jnp.asarray, laid._replace(**arrays))
