"""A walk in front of a 3 x 4 array, as the points that such a device reports.

python examples/point_cloud.py
python examples/point_cloud.py --radar indoor-60 --output out
"""

from __future__ import annotations

import argparse
from pathlib import Path

import t2d_rt as t2d
from t2d_rt.core.resources import resource
from t2d_rt.plots import plot_point_cloud
from t2d_rt.signal import point_cloud


def detections(radar_name: str, output: Path, duration_s: float | None = None) -> Path:
    """Simulates the CMU walk, with thermal noise, and draws all detections; returns where the picture is."""
    motion = t2d.place(t2d.load_motion(resource("motions", "12_01_walk.bvh")), angle_deg=20)
    if duration_s is not None:
        motion = t2d.trim(motion, 0.0, duration_s)
    radar = t2d.Radar.preset(radar_name)
    recording = t2d.simulate(motion, radar=radar, seed=0, noise=t2d.Receiver())
    cloud = point_cloud(recording.cube, radar, false_alarm_rate=1e-8)
    print(f"SNR {recording.snr_db:.1f} dB before processing")
    print(f"{len(cloud.time_s)} points, {cloud.range_m.min():.1f} to {cloud.range_m.max():.1f} m")
    output.mkdir(parents=True, exist_ok=True)
    picture = output / f"point_cloud_{radar_name}.png"
    plot_point_cloud(cloud.xyz_m, cloud.speed_mps).savefig(picture)
    return picture


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--radar", default="array-3x4", help="a preset with several antennas")
    parser.add_argument("--output", type=Path, default=Path("out"), help="folder for the picture")
    options = parser.parse_args()
    print("wrote", detections(options.radar, options.output))
