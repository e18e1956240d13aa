"""The leg EKF of Bennett et al. (2013): Table II in simulation, and what it reaches on real recordings.

Real recordings: `neura_sparse` (one person, motion capture: angles and foot path) and `walking5m` (distance). Each
improvement over the paper's pipeline is measured alone, and parameters tuned on one walk are judged on another.
"""

from typing import Any

import jax
import numpy as np
import optax
from common import Row, main, show

from jgait import datasets, params, tune
from jgait.commands import demonstration as demo
from jgait.estimators import leg_ekf
from jgait.estimators.leg_ekf import DEFAULT, PAPER, BySide, LegOptions, LegParams
from jgait.evaluate import FIELDS
from jgait.evaluate.windows import Judged, judge
from jgait.simulate import protocols
from jgait.types import SIDES, Recording, RecordingError, as_float

IMPROVEMENTS: dict[str, dict[str, Any]] = {
    "gravity inclination": {"gravity": True},
    "kinematic closure": {"closure": True},
    "standing": {"standing": True},
    "smoothing": {"smooth": True},
    "full rate, no median filter": {"rate_hz": None, "median": 1},
}
"""What the default does beyond the paper, one argument each; the axis and the distance are measured apart."""


def errors_of(judged: Judged) -> list[float]:
    """Hip, knee, x and y of the right leg, then of the left."""
    return [judged.rmse[side][column] for side in SIDES for column in FIELDS]


def person(walk: datasets.Walk) -> LegParams:
    """Default parameters with the person's own leg lengths."""
    return leg_ekf.with_body(LegParams(), datasets.body(walk))


def known_pose(p: LegParams, walk: datasets.Walk) -> LegParams:
    """The same with the true standing pose, from motion capture."""
    start, stop = walk.info["windows"]["standing"]
    legs = walk.reference.legs

    def mean(field: str) -> BySide:
        return BySide(*(float(np.mean(as_float(getattr(getattr(legs, s), field))[start:stop])) for s in SIDES))

    return p._replace(standing_hip=mean("hip_angle"), standing_knee=mean("knee_angle"))


def real_walks(quick: bool) -> list[Row]:
    """`neura_sparse`: the reproduction, the default, each improvement alone, and the held-out walk."""
    walk = datasets.load("neura_sparse")[0]
    p, windows = person(walk), walk.info["windows"]
    standing = windows["standing"]

    def judged(q: LegParams, options: LegOptions, window: str) -> Judged:
        return judge(leg_ekf.estimate(q, walk.recording, options), walk.reference, windows[window], standing)

    rows: list[Row] = []

    def record(prefix: str, result: Judged, columns: tuple[str, ...], split: str) -> None:
        for column in columns:
            for side in SIDES:
                name, unit = column.rsplit("_", 1)
                rows.append(Row(f"{prefix}_{name}_{unit}_{side}", result.rmse[side][column], unit, n=1, split=split))

    everything = tuple(FIELDS)
    untuned = "neura_sparse, untuned"
    cases = [("paper", PAPER, p), ("default", DEFAULT, p)]
    if not quick:
        cases.append(("known_pose", DEFAULT, known_pose(p, walk)))
    for name, options, q in cases:
        for part, window in (("straight", "straight_1"), ("whole", "whole")):
            result = judged(q, options, window)
            record(f"{name}_{part}", result, everything, f"{untuned}, {part}")
            rows.append(Row(f"{name}_{part}_distance_error_pct", result.distance_error_pct or 0.0, "%", split=untuned))
            if result.within_two_sigma is not None:
                share = 100.0 * result.within_two_sigma
                rows.append(Row(f"{name}_{part}_within_two_sigma_pct", share, "%", split=untuned))
    if quick:
        return rows
    improvements(judged, p)
    return rows + held_out(walk, p)


def improvements(judged: Any, p: LegParams) -> None:
    """Print the effect of every improvement: added alone to the paper's pipeline, and taken alone from the default."""
    lines = []
    paper, best = PAPER, DEFAULT
    variants = [("the paper's pipeline", paper)]
    variants += [(f"  + {name}", paper._replace(**change)) for name, change in IMPROVEMENTS.items()]
    variants += [
        ("  raw principal axis", paper._replace(perpendicular_axis=False)),
        ("  literal F and Q (misprints), σ_θ = 0.01", paper._replace(literal=True)),
        ("the default", best),
    ]
    variants += [
        (f"  − {name}", best._replace(**{field: getattr(paper, field) for field in change}))
        for name, change in IMPROVEMENTS.items()
    ]
    variants.append(("  raw principal axis", best._replace(perpendicular_axis=False)))
    for name, options in variants:
        # The printed Q holds powers of σ_θ, and is of use only where these are small.
        q = p._replace(angle_noise=0.01) if options.literal else p
        whole = judged(q, options, "whole")
        lines.append([name, *errors_of(judged(q, options, "straight_1")), *errors_of(whole), whole.distance_error_pct])
    columns = [f"{column} {side[0]}" for side in SIDES for column in ("hip°", "knee°", "x cm", "y cm")]
    show("neura_sparse, straight part, by improvement", ["", *columns], [line[:9] for line in lines])
    show(
        "neura_sparse, whole walk with the U-turn, by improvement",
        ["", *columns, "distance %"],
        [[line[0], *line[9:]] for line in lines],
    )


def held_out(walk: datasets.Walk, p: LegParams) -> list[Row]:
    """Tune on the walk out (S1), judge on the walk back (S2)."""
    options = demo.OPTIONS
    item, unseen = (
        tune.lessons(leg_ekf.estimator(options), [walk], own=datasets.body, windows=tune.named_windows(look)).one(0)
        for look in ("straight_1", "straight_2")
    )
    loss = tune.Objective(leg_ekf.run, leg_ekf.with_body, options, (("trajectory", 1.0), ("distance", 1.0)))
    fit = tune.fit(
        loss, p,
        params.freed(leg_ekf.TRANSFORMS, "standing_hip", "standing_knee", "thigh_gain", "distance_scale"),
        item, optax.adam(0.03), steps=80, batched=False,
    )  # fmt: skip
    inputs = jax.tree.map(jax.numpy.asarray, unseen.inputs)
    before, after = (
        judge(leg_ekf.run(q, inputs, options), unseen.reference, *demo.spans(unseen)) for q in (p, fit.params)
    )
    distance = [abs(j.distance_error_pct or 0.0) for j in (before, after)]
    pairs = list(zip([*errors_of(before), distance[0]], [*errors_of(after), distance[1]], strict=True))
    names = [f"{side} {column}" for side in SIDES for column in FIELDS] + ["distance_pct"]
    show(
        "neura_sparse: tuned on the walk out, judged on the walk back",
        ["error", "untuned", "tuned"],
        [[name, *pair] for name, pair in zip(names, pairs, strict=True)],
    )
    split = "tuned on S1, judged on S2"
    return [
        Row("heldout_distance_error_pct", distance[1], "%", split=split),
        Row("heldout_worst_metric_ratio", max(b / a for a, b in pairs), "ratio", n=len(pairs), split=split),
    ]


def distances(quick: bool) -> list[Row]:
    """`walking5m`: every recording gives a distance or a named reason; one scale learned on all other people."""
    names = datasets.names("walking5m")
    walks = datasets.load("walking5m", only=names[:3] if quick else None)
    reasons = [[failure.name, failure.reason] for failure in walks.failures]
    found: list[tuple[str, str, float, float, float]] = []
    for walk in walks:
        name = walk.recording.name
        if walk.reference is None:
            reasons.append([name, f"no reference: {walk.info['no_reference']}"])
            continue
        try:
            ours = leg_ekf.estimate(person(walk), walk.recording)
            theirs = leg_ekf.estimate(person(walk), walk.recording, PAPER)
        except RecordingError as error:
            reasons.append([name, str(error)])
            continue
        true = float(as_float(walk.reference.distance)[-1])
        found.append((name, walk.recording.subject, true, float(ours.distance[-1]), float(theirs.distance[-1])))
    subjects = np.array([f[1] for f in found])
    true, ours, theirs = (np.array([f[k] for f in found]) for k in (2, 3, 4))
    default, paper = (100.0 * (leave_one_out(subjects, true, v) / true - 1.0) for v in (ours, theirs))
    constant = 100.0 * (leave_one_out(subjects, true, np.ones_like(true)) / true - 1.0)
    show(
        "walking5m: distance with one scale learned on the other people",
        ["recording", "foot trajectories [m]", "error %, default", "error %, paper's pipeline"],
        [[f[0], f[2], float(d), float(q)] for f, d, q in zip(found, default, paper, strict=True)],
    )
    if reasons:
        show("walking5m: not used", ["recording", "reason"], reasons)
    split = "leave one subject out"
    n = len(found)
    return [
        Row("walking5m_loso_distance_mae_pct", float(np.mean(np.abs(default))), "%", n=n, split=split),
        Row("walking5m_loso_distance_median_pct", float(np.median(np.abs(default))), "%", n=n, split=split),
        Row("walking5m_loso_distance_worst_pct", float(np.max(np.abs(default))), "%", n=n, split=split),
        Row("walking5m_loso_paper_mae_pct", float(np.mean(np.abs(paper))), "%", n=n, split=split),
        Row("walking5m_loso_constant_mae_pct", float(np.mean(np.abs(constant))), "%", n=n, split=split),
        Row("walking5m_not_used", float(len(reasons)), "recordings", n=n + len(reasons), split=split),
    ]


def leave_one_out(subjects: np.ndarray, true: np.ndarray, raw: np.ndarray) -> np.ndarray:
    """Each distance times the median scale of all other subjects."""
    return np.array([raw[k] * np.median((true / raw)[subjects != subjects[k]]) for k in range(raw.size)])


def simulation(quick: bool) -> list[Row]:
    """Table II: 3 to 4 m at 50 Hz with IDG-300-like gyroscopes; the scale is learned on as many other people.

    With the right leg alone, as in the paper, the foot's displacement is judged; with both legs the hip's.
    """
    people = 4 if quick else 32
    learn, test = (protocols.bennett(jax.random.key(seed), people) for seed in (1, 2))

    def one_leg(recording: Recording) -> Recording:
        kept = {name: imu for name, imu in recording.sensors.items() if name.endswith("right")}
        return recording._replace(sensors=kept)

    def run(cohort: Any, options: LegOptions, both: bool) -> list[tuple[np.ndarray, np.ndarray]]:
        pairs = []
        for recording, known, _ in cohort:
            truth = known.estimate
            own = truth.diagnostics
            p = LegParams(
                thigh_length=BySide(*(float(own["thigh_length"]),) * 2),
                shank_length=BySide(*(float(own["shank_length"]),) * 2),
            )
            estimate = leg_ekf.estimate(p, recording if both else one_leg(recording), options)
            ours = np.interp(as_float(truth.time), as_float(estimate.time), as_float(estimate.distance))
            pairs.append((ours, as_float(truth.distance if both else own["foot_displacement_right"])))
        return pairs

    lines, rows = [], []
    cases = [
        ("paper", "paper: Σ Δx⁺ + Σ |Δy|", PAPER, False, False),
        ("paper_calibrated", "paper, calibrated", PAPER, False, True),
        ("one_leg", "default, right leg only, Σ Δx⁺ calibrated", DEFAULT._replace(distance="forward"), False, True),
        ("", "default, both legs, calibrated", DEFAULT, True, True),
    ]
    for name, label, options, both, calibrated in cases:
        scale = float(np.median([t[-1] / o[-1] for o, t in run(learn, options, both)])) if calibrated else 1.0
        pairs = run(test, options, both)
        percent = np.array([100.0 * (scale * o[-1] / t[-1] - 1.0) for o, t in pairs])
        displacement = np.array([100.0 * np.sqrt(np.mean((scale * o - t) ** 2)) for o, t in pairs])
        error, rmse = float(np.mean(np.abs(percent))), float(np.mean(displacement))
        lines.append([label, scale, error, float(np.max(np.abs(percent))), rmse, float(np.max(displacement))])
        split = f"scale learned on {people} other simulated people" if calibrated else "simulated, untuned"
        prefix = f"sim_{name}_" if name else "sim_"
        rows += [
            Row(f"{prefix}distance_error_pct", error, "%", 2.04, people, split),
            Row(f"{prefix}displacement_rmse_cm", rmse, "cm", 7.0, people, split),
        ]
    lines.append(["paper, real walks", "–", 2.04, "–", 7.0, "–"])
    columns = ["read-out", "scale", "distance error %", "worst %", "displacement RMSE cm", "worst cm"]
    show(f"Table II in simulation: {people} people of 3 to 4 m, 50 Hz", columns, lines)
    return rows


def experiment(quick: bool) -> list[Row]:
    """All parts; what needs recordings that are not here says so and is left out."""
    rows = simulation(quick)
    for name, part in (("neura_sparse", real_walks), ("walking5m", distances)):
        if datasets.available(name):
            rows += part(quick)
        else:
            print(f"left out: {datasets.unavailable_reason(name)}")
    return rows


if __name__ == "__main__":
    main("leg_ekf", __doc__.splitlines()[0], experiment)
