"""Builds the clips that ship: `python -m validation.motions.build_library FOLDER`.

FOLDER holds the recorded motions. Clips are read, cut where they have defects, resampled at 60 Hz, labelled by what is measured of
them and written to t2d_rt/motion/generate/library/data; the same folder gives the same bytes.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import json
import re
import warnings
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import load_motion, quaternions, resample
from t2d_rt.motion.contacts import CONTACT_SPEED_MPS, contacts, runs, soles
from t2d_rt.motion.generate.chain import Piece, heading_rad, moved, rotation_vector
from t2d_rt.motion.generate.library.store import FOLDER, RATE_HZ, Segment, Source, packed, unpacked
from t2d_rt.motion.kinematics import INDEX, NAMES, Poses, poses_of
from validation.motions.clip_labels import labelled
from validation.motions.limits import true_size

CMU, MIT, APACHE = "CMU", "MIT (DeepMimic)", "Apache-2.0 (Kimodo)"

RECIPES: tuple[tuple[str, str, str, str], ...] = (
    # File, licence, subject, and what it shows: the rule that cuts it.
    (r"library/cmu/walking_extra_test_.*", CMU, "cmu-a", "walk"),
    (r"library/cmu/walking_.*", CMU, "cmu-b", "walk"),
    (r"library/cmu/running_.*", CMU, "cmu-r", "run"),
    (r"library/cmu/jumping_.*", CMU, "cmu-j", "jump"),
    (r"library/iclone/007_.*", CMU, "cmu-07", "walk"),
    (r"library/iclone/003_01.*", CMU, "cmu-03", "none"),
    (r"library/iclone/005_.*", CMU, "cmu-05", "dance"),
    (r"12_01_walk.*", CMU, "cmu-12", "walk"),
    (r"iclone_002_01_walk.*", CMU, "cmu-02", "walk"),
    (r"iclone_002_03_run.*", CMU, "cmu-02", "run"),
    (r"iclone_002_04_jump.*", CMU, "cmu-02", "jump"),
    (r"iclone_005_03_.*", CMU, "cmu-05", "dance"),
    (r"jumping_jacks_.*", CMU, "cmu-14", "jacks"),
    (r"amp15_09_11_run.*", CMU, "cmu-09", "run"),
    (r"amp15_49_08_hop.*", CMU, "cmu-49", "hop"),
    (r"amp15_55_01_dance.*", CMU, "cmu-55", "dance"),
    (r"library/deepmimic/.*_(walk)\.txt", MIT, "dm", "walk"),
    (r"library/deepmimic/.*stealthy_walk\.txt", MIT, "dm", "stealthy"),
    (r"library/deepmimic/.*_(run|jog)\.txt", MIT, "dm", "run"),
    (r"library/deepmimic/.*_jump\.txt", MIT, "dm", "jump"),
    # In dance_b no foot rests for 0.41 s: it slides.
    (r"library/deepmimic/.*_dance_spin\.txt", MIT, "dm", "dance"),
    (r"library/deepmimic/.*_(dance_a|spin)\.txt", MIT, "dm", "stepping dance"),
    (r"library/deepmimic/.*getup_faceup\.txt", MIT, "dm", "getup_faceup"),
    (r"more/.*getup_facedown\.txt", MIT, "dm", "getup_facedown"),
    (r"library/kimodo/05.*\.npz", APACHE, "kimodo", "walk"),
)  # fmt: skip

FLIP_DEG_PER_S = 1500.0
"""Rate at which a joint turns in a flip; recorded runs and dances stay below 1 400 except at ends of limbs."""
FLIP_RATIO = 4.0
"""A flip is that much faster than its neighbourhood's median."""
FASTEST_MPS = 12.0
"""Of joints; a running foot reaches 8.4 m/s, a dancer's hand 8."""
MOST_JUMP_M = 0.04
"""A joint's greatest distance from the middle of its neighbours in time; of recorded motion without glitches 0.05 at most."""
MOST_BEND_DEG = 8.0
"""Change of an end's turn from one frame to the next two."""
ENDS = {INDEX[f"{side}_{name}"] for side in ("left", "right") for name in ("wrist", "ankle", "foot")}
"""Joints that may be mended by interpolation: hardly anything hangs on them."""

SLIDING_MPS = {"run": 0.4, "dance": 0.4, "stepping dance": 0.8}
"""Speed up to which a runner's or a dancer's foot stands: files of 15 markers let it slide, and two dances of DeepMimic step so
quickly that a foot hardly rests. The filter takes some of their steps of 0.4 to 0.8 m/s for planted; they slid by up to 0.12 m."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--output", type=Path, default=FOLDER)
    options = parser.parse_args()
    warnings.simplefilter("ignore", T2DWarning)
    arrays: dict[str, np.ndarray] = {}
    sources: dict[str, Source] = {}
    segments: list[Segment] = []
    for path in sorted(options.folder.rglob("*")):
        place = path.relative_to(options.folder).as_posix()
        recipe = next((each for each in RECIPES if re.fullmatch(each[0], place)), None)
        if recipe is None or not path.is_file():
            continue
        try:
            pieces = clean(path, SLIDING_MPS.get(recipe[3], CONTACT_SPEED_MPS))
        except InputError as error:
            print(f"{place}: {error}")
            continue
        for number, piece in enumerate(pieces):
            name = re.sub(r"(\.bvh|\.gz|\.npz|\.txt|humanoid3d_|_joints)", "", path.name) + (
                "abcdefgh"[number] if number else ""
            )
            found = labelled(name, piece, recipe[3])
            if not found:
                print(f"{place}: nothing in part {number} ({len(piece) / RATE_HZ:.1f} s)")
                continue
            first, last = min(each.start for each in found), max(each.stop for each in found)
            found = [replace(each, start=each.start - first, stop=each.stop - first) for each in found]
            piece = piece.part(first, last)
            piece = moved(piece, -heading_rad(piece.poses)[0], piece.poses.root[0, :2], np.zeros(2))
            arrays[name], arrays[f"{name}.skeleton"] = packed(piece.poses, piece.planted)
            check_storage(name, piece, arrays)
            sources[name] = Source(file=path.name, licence=recipe[1], sha256=digest(path), subject=recipe[2])
            segments += found
    write(options.output, arrays, sources, segments)


def clean(path: Path, contact_mps: float) -> list[Piece]:
    """A recording's parts without defects, at 60 Hz, the level of the balls of the feet at 0."""
    motion = true_size(load_motion(path), path.name)
    if motion.rate_hz != RATE_HZ:
        motion = resample(motion, RATE_HZ)
    poses = poses_of(motion)
    poses, bad = mended(poses)
    parts = [(start, stop) for start, stop in runs(~bad) if stop - start >= 45]
    found = []
    for start, stop in parts:
        part = poses.part(start, stop)
        points = soles(part)
        planted = contacts(part, speed_mps=contact_mps)
        lowest = points[..., 2].min(axis=(1, 2))[planted.any(axis=(1, 2))]
        level = float(np.median(lowest)) if len(lowest) > 10 else float(np.percentile(points[..., 2], 2))
        root = part.root - [0.0, 0.0, level]
        found.append(Piece(poses=replace(part, root=root), planted=planted))
    return found


def mended(poses: Poses) -> tuple[Poses, np.ndarray]:
    """Poses whose wrists and toes do not flip, and where other joints do or tear away (T,)."""
    from scipy.ndimage import binary_dilation, median_filter

    step = quaternions.multiply(poses.local[1:], quaternions.conjugate(poses.local[:-1]))
    rate = np.degrees(2 * np.arccos(np.clip(np.abs(step[..., 3]), 0, 1))) * poses.rate_hz
    usual = median_filter(rate, size=(13, 1), mode="nearest")
    flips = (rate > FLIP_DEG_PER_S) & (rate > FLIP_RATIO * usual)
    # Change of the rate from frame to frame, as an angle: what a joint is away from the middle of its neighbours in time, twice.
    bends = np.degrees(np.linalg.norm(np.diff(rotation_vector(step), axis=0), axis=-1))
    local = poses.local.copy()
    for joint in ENDS:
        wrong = np.append(flips[:, joint], False) | np.append(False, flips[:, joint])
        wrong[1:-1] |= bends[:, joint] > MOST_BEND_DEG
        wrong = binary_dilation(wrong, iterations=4)
        for start, stop in runs(wrong):
            before, after = (start - 1 if start else stop), (stop if stop < len(local) else start - 1)
            weight = ((np.arange(start, stop) - (start - 1)) / (stop - start + 1))[:, None]
            smooth = weight * weight * (3 - 2 * weight)
            local[start:stop, joint] = quaternions.blend(local[[before], joint], local[[after], joint], smooth)
    poses = replace(poses, local=quaternions.continuous(local))
    joints, _ = poses.world()
    fast = np.linalg.norm(np.diff(joints, axis=0), axis=-1).max(axis=1) * poses.rate_hz > FASTEST_MPS
    others = [joint for joint in range(len(NAMES)) if joint not in ENDS]
    bad = np.append(fast | flips[:, others].any(axis=1), False)
    jumps = np.linalg.norm(joints[1:-1] - 0.5 * (joints[2:] + joints[:-2]), axis=-1).max(axis=1) > MOST_JUMP_M
    bad[1:-1] |= jumps
    return poses, binary_dilation(bad, iterations=4) if bad.any() else bad


def check_storage(name: str, piece: Piece, arrays: dict[str, np.ndarray]) -> None:
    """Refuses a clip that storage changes by more than 1 mm or 0.01 m/s at any joint."""
    found, planted = unpacked(arrays[name], arrays[f"{name}.skeleton"])
    error = found.world()[0] - piece.poses.world()[0]
    speed = np.linalg.norm(np.diff(error, axis=0), axis=-1).max() * RATE_HZ
    assert np.linalg.norm(error, axis=-1).max() < 1e-3, f"{name}: {np.linalg.norm(error, axis=-1).max() * 1e3:.2f} mm"
    WORST.append(
        (
            float(np.linalg.norm(error, axis=-1).max()),
            float(np.sqrt(np.mean(np.diff(error, axis=0) ** 2) * 3) * RATE_HZ),
            speed,
        )
    )
    assert (planted == piece.planted).all()


WORST: list[tuple[float, float, float]] = []


def digest(path: Path) -> str:
    """SHA-256 of a file's content, unpacked."""
    data = path.read_bytes()
    return hashlib.sha256(gzip.decompress(data) if path.suffix == ".gz" else data).hexdigest()


def write(folder: Path, arrays: dict[str, np.ndarray], sources: dict[str, Source], segments: list[Segment]) -> None:
    """Both files, one line per segment and source."""
    folder.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    (folder / "clips.npz").write_bytes(buffer.getvalue())

    def lines(values: list[str]) -> str:
        return ",\n".join(values)

    plain = [
        json.dumps({key: value for key, value in asdict(each).items() if value not in ("", 0.0) or key == "start"})
        for each in segments
    ]
    origin = [f"{json.dumps(name)}: {json.dumps(asdict(each))}" for name, each in sorted(sources.items())]
    (folder / "index.json").write_text(
        f'{{"segments": [\n{lines(plain)}\n],\n"sources": {{\n{lines(origin)}\n}}}}\n', encoding="ascii"
    )
    worst = np.array(WORST).max(axis=0)
    print(
        f"{len(sources)} clips, {len(segments)} segments, {len(buffer.getvalue()) / 1e6:.2f} MB; storage changes "
        f"joints by {worst[0] * 1e3:.2f} mm at most, speeds by {worst[1]:.4f} m/s RMS, {worst[2]:.4f} at most"
    )


if __name__ == "__main__":
    main()
