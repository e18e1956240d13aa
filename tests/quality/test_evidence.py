"""Facts about sensors: merged, written as notes, and carried by recordings."""

import pickle
from types import SimpleNamespace

import jax
import numpy as np

from jgait.quality import SOUND, SensorQuality, merged, notes, of_sensor
from jgait.quality.evidence import of_sensors
from jgait.types import Imu, Recording


def test_a_sensor_has_the_facts_of_all_parts_and_one_without_any_is_sound():
    first = {"foot_left": SensorQuality(late=0.1, lost=3), "waist": SOUND}
    whole = merged(first, {"foot_left": SensorQuality(lost=5)})
    assert whole == {"foot_left": SensorQuality(late=0.1, lost=5), "waist": SOUND}
    assert first["foot_left"].lost == 3
    assert of_sensor(whole, "foot_right") is SOUND
    assert not (SOUND.wrong or SOUND.runs)
    assert SensorQuality(acc_late=-0.02).wrong and SensorQuality(quick_stride=0.6).runs


def test_a_note_states_each_contradiction_once():
    quality = {
        "shank_right": SensorQuality(late=-0.1, faster=1.7), "foot_left": SensorQuality(step_share=0.3),
        "waist": SensorQuality(left_out="it has no usable sample", lost=9),
    }  # fmt: skip
    assert [": ".join(str(note).split(": ")[:2]) for note in notes.contradictions(quality)] == [
        "shank_right: it turns 1.70 times as fast as shank_left",
        "shank_right: it is 100 ms ahead of thigh_right; one of the two clocks is wrong",
        "foot_left: it follows foot_right by 0.30 of a stride in place of a half",
    ]
    assert [str(note) for note in notes.left_out(quality)] == ["waist is left out: it has no usable sample"]
    assert notes.contradictions({"foot_left": SOUND}) == notes.left_out({"foot_left": SOUND}) == []


def test_a_recording_carries_its_quality_through_copies_pickles_and_trees():
    time = np.arange(3.0)
    quality = {"waist": SensorQuality(rows_lost=2)}
    bare = Recording({"waist": Imu(time, np.zeros((3, 3)), None, np.ones(3, bool))}, 1.0)
    recording = bare._replace(quality=quality)
    assert bare.quality == {} and recording._replace(name="b").quality == quality
    assert pickle.loads(pickle.dumps(recording)).quality == quality
    leaves, structure = jax.tree.flatten(recording)
    assert jax.tree.unflatten(structure, leaves).quality == quality


def test_rates_whose_sign_is_reversed_are_evidence_and_no_error():
    found = SimpleNamespace(
        diagnostics={"sensors": {"foot_left": SensorQuality(rates_factor=-1.0, rates_off=True)}},
        strides=SimpleNamespace(side=np.array([1])),
    )
    assert of_sensors(found, {1: "foot_left"})["rates"] > 2.0
