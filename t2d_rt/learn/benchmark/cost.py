"""What the benchmark at the scale of the paper would take on this machine: planned and costed, not run."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from t2d_rt.learn.baselines import BASELINES
from t2d_rt.learn.benchmark.cells import cells_of
from t2d_rt.learn.benchmark.scales import SETS, Scale
from t2d_rt.learn.markdown import table
from t2d_rt.learn.models import build
from t2d_rt.learn.require import require_learning
from t2d_rt.learn.threads import torch_threads
from t2d_rt.learn.train.sides import FRACTIONS

EPOCHS = 40
"""That a training takes until nothing gets better, of 100 at most; an assumption, as is the speed of simulation."""
SAMPLES_PER_S = 1.06
"""By ellipsoids on two cores (docs/datasets.md)."""
BATCH, STEPS = 4, 2


def paper_plan(scale: Scale, folder: Path) -> Path:
    """Measures a few training steps of each network and writes plan.md; its path."""
    samples = {name: scale.recipe(name).samples for name in SETS}
    trained = {name: FRACTIONS[0] * number for name, number in samples.items()}
    cells = [each for each in cells_of(scale) if each.model not in BASELINES]
    rows, total = [], 0.0
    for model in (each for each in scale.models if each not in BASELINES):
        seconds = seconds_per_sample(model, scale.size)
        own = [each for each in cells if each.model == model]
        hours = sum(seconds * trained[each.set] * EPOCHS for each in own) / 3600.0
        total += hours
        rows.append((model, f"{1e3 * seconds:.1f}", str(len(own)), f"{hours:.0f}"))
    data_h = sum(samples.values()) / SAMPLES_PER_S / 3600.0
    text = (
        f"# Plan of the scale {scale.name}\n\n{len(cells)} trainings at {scale.size} x {scale.size} cells on "
        f"{', '.join(f'{name} ({number} samples)' for name, number in samples.items())}, {EPOCHS} epochs each assumed. Simulation: "
        f"{data_h:.0f} hours on two cores at {SAMPLES_PER_S:g} samples a second. Training: {total:.0f} hours on one core of this "
        "machine, measured by a few steps of each network; a GPU divides that by some tens.\n\n"
        + table(("model", "training [ms per sample]", "trainings", "hours"), rows)
        + "\n"
    )
    path = folder / "plan.md"
    path.write_text(text, "utf-8")
    return path


def seconds_per_sample(model: str, size: int) -> float:
    """Time that training takes for one sample, by one thread [s]."""
    require_learning()
    import torch

    with torch_threads(1):
        network = build(model, 8, (size, size)).train()
        optimizer = torch.optim.Adam(network.parameters())
        maps, labels = torch.rand(BATCH, 1, size, size), torch.arange(BATCH) % 8
        times = []
        for _ in range(STEPS):
            started = time.perf_counter()
            optimizer.zero_grad()
            torch.nn.functional.cross_entropy(network(maps), labels).backward()
            optimizer.step()
            times.append(time.perf_counter() - started)
    return float(np.min(times)) / BATCH
