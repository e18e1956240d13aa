"""mobgap on a sensor at the lower back: contacts by its detectors, left and right, step lengths, cadence, speed.

Each walking bout is treated as mobgap's own pipeline treats it: the detector gets the bout, the side is computed from
it, then it is cut to its first and last contact, and lengths, cadence and speed come from that.

Takes, for each job:
    acc: (T, 3) [m/s²], x up, y right, z forwards.
    gyr: (T, 3) [rad/s], the same axes.
    sampling_rate_hz: scalar.
    bouts: (b, 2) [samples] of walking, half-open, at least 0.5 s each; the detectors find no contact at the very edges.
    sensor_height: [m] above the ground when standing.
    contacts: (n,) [samples] known ones, in order; absent: only mobgap's.

Gives, for each source of contacts in SOURCES (`given` are those that came, if any; those outside all bouts are left
out):
    SOURCE_contacts: (n,) [samples]; SOURCE_bouts: (n,) which bout each is in.
    SOURCE_sides_ullrich, SOURCE_sides_mccamley: (n,) 0 right, 1 left.
    SOURCE_step_lengths_ms_all, SOURCE_step_lengths_ms_ms: (n,) [m] from each contact to the next, by either of the
        settings that mobgap gives, learned on everybody or on patients; NaN for the last contact of a bout.
    SOURCE_distances_ms_all, SOURCE_distances_ms_ms: (b,) [m] from the first contact to the last.
    SOURCE_speeds_ms_all, SOURCE_speeds_ms_ms: (b,) [m/s] mean of mobgap's speeds second by second.
    SOURCE_cadences: (b,) [steps/s] likewise.
"""

import warnings

import numpy as np
import pandas as pd
from mobgap.cadence import CadFromIc
from mobgap.initial_contacts import IcdHKLeeImproved, IcdIonescu, IcdShinImproved, refine_gs
from mobgap.laterality import LrcMcCamley, LrcUllrich
from mobgap.stride_length import SlZijlstra
from protocol import main

DETECTORS = {"ionescu": IcdIonescu, "shin": IcdShinImproved, "hklee": IcdHKLeeImproved}
SOURCES = (*DETECTORS, "given")
SIDES = {"ullrich": LrcUllrich, "mccamley": LrcMcCamley}
LENGTHS = {
    "ms_all": SlZijlstra.PredefinedParameters.step_length_scaling_factor_ms_all,
    "ms_ms": SlZijlstra.PredefinedParameters.step_length_scaling_factor_ms_ms,
}
SHORTEST = 0.5  # [s] mobgap's filters fail on less than 0.28 s, and less than two steps have no step length
COLUMNS = ["acc_is", "acc_ml", "acc_pa", "gyr_is", "gyr_ml", "gyr_pa"]


def listed(contacts):
    """Contacts as mobgap lists them."""
    index = pd.RangeIndex(len(contacts), name="step_id")
    return pd.DataFrame({"ic": np.asarray(contacts, np.int64)}, index=index)


def lengths(data, contacts, rate_hz, sensor_height):
    """Results of a bout's contacts: step lengths, and distance, speed and cadence of the bout."""
    names = [f"{what}_{setting}" for setting in LENGTHS for what in ("distances", "speeds")]
    of_bout = dict.fromkeys([*names, "cadences"], np.nan)
    steps = {f"step_lengths_{setting}": np.full(len(contacts), np.nan) for setting in LENGTHS}
    if len(contacts) < 2:
        return steps, of_bout
    refined, of_refined = refine_gs(contacts)
    start, end = refined.iloc[0][["start", "end"]]
    part, common = data.iloc[start:end].reset_index(drop=True), {"sampling_rate_hz": rate_hz}
    cadence = (
        CadFromIc().calculate(part, initial_contacts=of_refined, **common).cadence_per_sec_["cadence_spm"].to_numpy()
        / 60
    )
    of_bout["cadences"] = mean(cadence)
    for setting, parameters in LENGTHS.items():
        found = SlZijlstra(**parameters).calculate(
            part, initial_contacts=of_refined, sensor_height_m=sensor_height, **common
        )
        step = found.raw_step_length_per_step_["step_length_m"].to_numpy()
        steps[f"step_lengths_{setting}"][:-1] = step
        stride = found.stride_length_per_sec_["stride_length_m"].to_numpy()
        of_bout |= {f"distances_{setting}": step.sum(), f"speeds_{setting}": mean(stride / 2 * cadence)}
    return steps, of_bout


def mean(values):
    """Mean of what is known; NaN if nothing is."""
    known = values[np.isfinite(values)]
    return known.mean() if len(known) else np.nan


def trunk(acc, gyr, sampling_rate_hz, bouts, sensor_height, contacts=None):
    """One recording; see the module."""
    rate_hz, height = float(sampling_rate_hz), float(sensor_height)
    data = pd.DataFrame(np.hstack([acc, np.rad2deg(gyr)]), columns=COLUMNS)
    bouts, shortest = np.asarray(bouts, np.int64).reshape(-1, 2), SHORTEST * rate_hz
    if len(bouts) == 0 or np.any(np.diff(bouts) < shortest) or bouts.min() < 0 or bouts.max() > len(data):
        raise ValueError(
            f"bouts of {SHORTEST} s or more inside the {len(data)} samples are needed; got {bouts.tolist()}"
        )
    results = {}
    for source in SOURCES if contacts is not None else DETECTORS:
        by_contact, by_bout = [], []
        for number, (start, end) in enumerate(bouts):
            part = data.iloc[start:end].reset_index(drop=True)
            if source == "given":
                found = listed(contacts[(contacts >= start) & (contacts < end)] - start)
            else:
                found = listed(DETECTORS[source]().detect(part, sampling_rate_hz=rate_hz).ic_list_["ic"].to_numpy())
            sides = {
                f"sides_{name}": (
                    method().predict(part, found, sampling_rate_hz=rate_hz).ic_lr_list_["lr_label"] == "left"
                ).to_numpy(np.int64)
                for name, method in SIDES.items()
            }
            steps, of_bout = lengths(part, found, rate_hz, height)
            where = {"contacts": found["ic"].to_numpy() + start, "bouts": np.full(len(found), number)}
            by_contact.append({**where, **sides, **steps})
            by_bout.append(of_bout)
        results |= {f"{source}_{name}": np.concatenate([of[name] for of in by_contact]) for name in by_contact[0]}
        results |= {f"{source}_{name}": np.array([of[name] for of in by_bout]) for name in by_bout[0]}
    return results


if __name__ == "__main__":
    # Seconds without a contact, bouts of a single one: all of it is NaN in what is given.
    warnings.filterwarnings("ignore", module="mobgap")
    main(trunk)
