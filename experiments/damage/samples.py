"""One small file of each format that jgait reads, with signals of nobody in particular."""

import gzip
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jgait import io
from jgait.estimators import leg_ekf

TIME = np.arange(120) / 100.0
GYR = np.sin(2.0 * np.pi * TIME[:, None] + np.arange(3.0)) * np.array([3.0, 1.0, 0.5])
ACC = np.array([9.8, 0.0, 0.0]) + np.cos(4.0 * np.pi * TIME[:, None] + np.arange(3.0))
DEG = np.rad2deg(GYR)
G = ACC / 9.80665


class Sample(NamedTuple):
    """A good file, perhaps with companions, and its reader.

    Attributes:
        files: path within a folder → content; any of them may be damaged.
        main: the file that is given to the reader.
        read: the reader.
    """

    files: dict[str, bytes]
    main: str
    read: Callable[[Path], Any]


def _text(head: Sequence[str], columns: Sequence[np.ndarray], separator: str = ",") -> bytes:
    rows = (separator.join(f"{cell:.6g}" for cell in row) for row in zip(*columns, strict=True))
    return ("\n".join([*head, *rows]) + "\n").encode()


def _axes(names: str, letters: str = "xyz") -> list[str]:
    return [name.replace("*", letter) for name in names.split() for letter in letters]


def _placed(path: Path) -> Any:
    return io.read(path, placement="shank_right")


def _texts() -> dict[str, Sample]:
    both, n = [*DEG.T, *ACC.T], np.arange(120)
    named = _axes("shank_right_gyr_* shank_right_acc_*")
    counted = ["PacketCounter", "SampleTimeFine", *_axes("Acc_* Gyr_*", "XYZ")]
    device = ["S_Timestamp_Unix_CAL", *_axes("S_Accel_LN_*_CAL S_Gyro_*_CAL", "XYZ")]
    xio = ["Timestamp (us)", *_axes("Gyroscope_*_(deg/s) Accelerometer_*_(g)", "XYZ")]
    physilog = [
        "Gait Up - Physilog data export", "Time [100 hz],Gyro [100 hz],,,Accel [100 hz],,",
        "Time,Gyro X,Gyro Y,Gyro Z,Accel X,Accel Y,Accel Z", "[s]" + ",[deg/s]" * 3 + ",[g]" * 3,
    ]  # fmt: skip
    gaitmap = [",".join(["right_sensor"] * 6), ",".join(_axes("gyr_* acc_*"))]
    angles = [np.sin(6.0 * TIME), 30.0 * np.sin(6.0 * TIME), -35.0 + 30.0 * np.cos(6.0 * TIME)]
    motion = ["Coordinates", "nRows=120", "nColumns=4", "inDegrees=yes", "endheader",
              "time\tpelvis_tilt\thip_flexion_r\tknee_angle_r"]  # fmt: skip

    def one(name: str, content: bytes, read: Callable[[Path], Any] = _placed) -> Sample:
        return Sample({name: content}, name, read)

    return {
        "csv": one("walk.csv", _text([",".join(["time", *named])], [TIME, *both]), io.read_csv),
        "gaitmap": one("feet.csv", _text(gaitmap, both), lambda path: io.read(path, sampling_rate_hz=100.0)),
        "mtw": one("MT_00B40C48.txt", _text(["// Update Rate: 100.0Hz", "\t".join(counted)],
                                            [n, n, *ACC.T, *GYR.T], "\t")),
        "dot": one("dot.csv", _text(["sep=,", "DeviceTag:,Shank", "SyncStatus:,Synced", "OutputRate:,100Hz", "",
                                     ",".join(counted)], [n, 10_000 * n, *ACC.T, *DEG.T])),
        "shimmer": one("shimmer.csv", _text(['"sep=\\t"', "\t".join(device),
                                             "ms" + "\tm/(s^2)" * 3 + "\tdeg/s" * 3],
                                            [1e3 * TIME, *ACC.T, *DEG.T], "\t")),
        "xio": one("Inertial.csv", _text([",".join(name.replace("_", " ") for name in xio)],
                                         [1e6 * TIME, *DEG.T, *G.T])),
        "physilog": one("RF.csv", _text(physilog, [TIME, *DEG.T, *G.T])),
        "opensim": one("walk.mot", _text(motion, [TIME, *angles], "\t"), _opensim),
    }  # fmt: skip


def _opensim(path: Path) -> Any:
    return io.opensim_reference(io.read_opensim(path), thigh_length=0.42, shank_length=0.4)


def _params(path: Path) -> Any:
    return io.read_params(path, leg_ekf.LegParams(), estimator="leg_ekf")


def _bids(zipped: bool) -> Sample:
    stem, rows = "sub-1_task-walk_tracksys-imu", ["name\tcomponent\ttype\ttracked_point\tunits"]
    for kind, unit in (("GYRO", "deg/s"), ("ACCEL", "m/s^2")):
        rows += [f"{kind}{axis}\t{axis}\t{kind}\trightShank\t{unit}" for axis in "xyz"]
    motion = _text([], [*DEG.T, *ACC.T], "\t")
    main = f"{stem}_motion.tsv" + (".gz" if zipped else "")
    files = {
        main: gzip.compress(motion, mtime=0) if zipped else motion,
        f"{stem}_channels.tsv": "\n".join(rows).encode(),
        f"{stem}_motion.json": json.dumps({"SamplingFrequency": 100}).encode(),
        "dataset_description.json": b"{}",
        "participants.tsv": b"participant_id\tage\nsub-1\t50\n",
    }
    return Sample(files, main, _placed)


def _hdf5(path: Path, old: bool) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        group = file.create_group("XI-1" if old else "Sensors/XI-1")
        signals = group.create_group("Calibrated") if old else group
        names = ("Gyroscopes", "Accelerometers") if old else ("Gyroscope", "Accelerometer")
        for name, values in zip(names, (GYR, ACC), strict=True):
            signals.create_dataset(name, data=values, compression=None if old else "gzip")
        group["Time"] = (1e6 * TIME).astype(np.uint64)
        if old:
            file.attrs["CaseIdList"], file.attrs["MonitorLabelList"] = [b"XI-1"], [b"Right Lower Leg"]
        else:
            about = group.create_group("Configuration").attrs
            about["Label 0"], about["Sample Rate"] = b"Right Lower Leg", 100


def samples(folder: Path) -> dict[str, Sample]:
    """Format → its good file.

    Args:
        folder: an empty folder.
    """
    import pandas as pd
    from scipy.io import savemat

    sensor = {"Gyr": DEG, "Acc": G, "Fs": {"Gyr": 100.0, "Acc": 100.0}, "Timestamp": 1.6e9 + TIME[:, None]}
    tree = {"TimeMeasure1": {"Test5": {"Trial1": {"SU": {"LowerBack": sensor}}}}}
    savemat(folder / "data.mat", {"data": tree}, do_compression=True)
    savemat(folder / "plain.mat", {"data": tree})
    _hdf5(folder / "new.h5", old=False)
    _hdf5(folder / "old.h5", old=True)
    columns = zip(["time", *_axes("shank_right_gyr_* shank_right_acc_*")], [TIME, *DEG.T, *ACC.T], strict=True)
    pd.DataFrame(dict(columns)).to_parquet(folder / "walk.parquet")
    io.write_params(folder / "tuned.json", leg_ekf.LegParams(), estimator="leg_ekf")
    written = {
        "parquet": ("walk.parquet", io.read), "mobilised": ("data.mat", io.read),
        "mobilised_plain": ("plain.mat", io.read), "apdm": ("new.h5", io.read),
        "apdm_old": ("old.h5", io.read), "params": ("tuned.json", _params),
    }  # fmt: skip
    made = {
        format: Sample({name: (folder / name).read_bytes()}, name, read) for format, (name, read) in written.items()
    }
    return _texts() | {"bids": _bids(False), "bids_gz": _bids(True)} | made
