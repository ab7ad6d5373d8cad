"""Points of MARS's IWR1443 beside simulated ones: ten rehabilitation movements of one subject, seen by a Kinect at the same time.

The first frames of each movement are made again: the Kinect's joints, smoothed as their noise asks for, are the motion, ellipsoids
or the mesh the body, `signal.sensor("mars")` the radar and its detection. Nothing is fitted. Points beyond 1 m to a side or in
height are left out of both, as the set's authors did.
"""

from __future__ import annotations

import gzip
import tempfile
from argparse import ArgumentParser, Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import InputError
from t2d_rt.motion import load_motion
from t2d_rt.signal import device_points, sensor
from t2d_rt.simulate import simulate
from t2d_rt.types import Motion, Receiver
from validation.studies.common import table, write_whole
from validation.studies.points import LIMIT

MEASURES = (
    "points a frame", "height over the radar [m]", "spread in height [m]", "speed [m/s]", "points at rest", "range [m]",
    "frames with points",
)  # fmt: skip
"""Of a movement: median number of points of the frames that have any; of the points the median height, what lies between 10
and 90 % of the heights, the mean absolute speed, the part of speed 0, the median range; part of the frames that have any."""
RATE_HZ, KINECT_JOINTS = 10.0, 25
SIDE_M = 1.0


def measures(numbers: np.ndarray, xyz_m: np.ndarray, speed_mps: np.ndarray) -> np.ndarray:
    """`MEASURES` from the numbers of points of all frames, positions ahead, to the left and up (point, 3), and speeds."""
    if not len(xyz_m):
        return np.array([0.0, *(len(MEASURES) - 2) * [np.nan], 0.0])
    low, middle, high = np.percentile(xyz_m[:, 2], (10, 50, 90))
    active = numbers[numbers > 0]
    return np.array([
        np.median(active), middle, high - low, np.abs(speed_mps).mean(),
        (np.abs(speed_mps) < 1e-6).mean(), np.median(np.linalg.norm(xyz_m, axis=1)), len(active) / len(numbers),
    ])  # fmt: skip


def recorded(folder: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Of each movement the numbers of its frames, and its points (point, 8): frame, number, right, ahead, up, speed, level, ..."""
    import h5py  # of the extra [hdf5]

    found = []
    for number in range(1, 11):
        with h5py.File(folder / f"radar_data{number}.mat") as file:
            points = file["radar_data_cropped"][()].T
        found.append((np.unique(points[:, 0]), points))
    return found


def kinect(folder: Path) -> tuple[list[str], np.ndarray]:
    """Names of the joints, and their places ahead, to the left and up (frame, joint, 3), of the training parts in order."""
    with gzip.open(folder / "kinect_data_train.csv.gz", "rt", encoding="utf-8") as file:
        names = [each.removesuffix("_X") for each in file.readline().strip().split(",")[:KINECT_JOINTS]]
        right, ahead, up = np.loadtxt(file, delimiter=",").reshape(-1, 3, KINECT_JOINTS).transpose(1, 0, 2)
    return names, np.stack([ahead, -right, up], axis=-1)


def motion_of(names: list[str], joints: np.ndarray) -> tuple[Motion, float]:
    """A motion over the floor, and how high the Kinect stands over it [m]."""
    height_m = -float(np.percentile(joints[..., 2].min(axis=1), 10))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "joints.npz"
        np.savez(path, joints=joints + np.array([0, 0, height_m]), names=names, fps=RATE_HZ, up="Z")
        motion = load_motion(path, floor=0.0)
    return replace(motion, placed=True), height_m


def add_options(parser: ArgumentParser) -> None:
    parser.add_argument("--recordings", required=True, help="folder of radar_data*.mat and kinect_data_train.csv.gz")
    parser.add_argument("--frames", type=int, default=100, help="frames of each movement")
    parser.add_argument("--method", choices=["ellipsoid", "mesh"], default="ellipsoid", help="model of the body")
    parser.add_argument("-o", "--output", required=True, help="text to write (.md)")


def run(options: Namespace) -> str:
    folder, real, made, begin = Path(options.recordings), [], [], 0
    names, joints = kinect(folder)
    for number, (frames, points) in enumerate(recorded(folder), 1):
        training = -(-3 * len(frames) // 5)  # 60 %, rounded up
        count = min(options.frames, training)
        own = points[np.isin(points[:, 0], frames[:count])]
        span = int(frames[count - 1] - frames[0]) + 1
        numbers = np.bincount((own[:, 0] - frames[0]).astype(int), minlength=span)
        xyz = own[:, [3, 2, 4]] * [1, -1, 1]
        real.append(measures(numbers, xyz, own[:, 5]))
        motion, height_m = motion_of(names, joints[begin : begin + count])
        begin += training
        radar, detection = sensor("mars", position_m=(0.0, 0.0, height_m))
        recording = simulate(
            motion, radar=radar, method=options.method, seed=number, noise=Receiver(), measure_error=False
        )
        whole = len(recording.cube) // (radar.loops_per_frame or 1) * (radar.loops_per_frame or 1)
        cloud = device_points(recording.cube[:whole], radar, detection)
        kept = (np.abs(cloud.xyz_m[:, 1:]) <= SIDE_M).all(axis=1)
        numbers = np.bincount(
            (cloud.time_s[kept] * RATE_HZ).astype(int), minlength=whole // (radar.loops_per_frame or 1)
        )
        made.append(measures(numbers, cloud.xyz_m[kept], cloud.speed_mps[kept]))
        print(number, np.round(real[-1], 2), np.round(made[-1], 2), flush=True)
    if begin != len(joints):
        raise InputError(
            f"{folder} has {len(joints)} frames of joints where the radar has {begin}; give one subject's files"
        )
    rows = []
    for name, told, ours in zip(MEASURES, np.array(real).T, np.array(made).T, strict=True):
        off = np.median(ours) / np.median(told) - 1
        rows.append([
            name, *(f"{np.median(x):.3g} ({np.percentile(x, 25):.3g} to {np.percentile(x, 75):.3g})" for x in (told, ours)),
            f"{100 * off:+.0f} %, {'within' if abs(off) <= LIMIT else '**outside**'}", f"{np.corrcoef(told, ours)[0, 1]:.2f}",
        ])  # fmt: skip
    target = Path(options.output).with_suffix(".md")
    head = ["measure", "recorded", f"simulated, {options.method}", "off by", "correlation over movements"]
    write_whole(target, f"{table(head, rows)}\n\n{' '.join((__doc__ or '').split())}\n")
    return f"wrote {target}"
