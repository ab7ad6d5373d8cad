"""Checkouts of MoMask whose program does anything: its folder is gone afterwards, and nothing that it has started is left."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from t2d_rt.motion.generate.momask import MoMask
from validation.robustness.fuzz.case import Attempt, Wrong, check_gone, check_motion, pick, quick_walk, writing_only

PROGRAM = """
import os, sys, time, signal, subprocess
import numpy as np
name = sys.argv[sys.argv.index("--ext") + 1]
folder = os.path.join("generation", name, "joints", "0")
os.makedirs(folder)
path = os.path.join(folder, "sample0_repeat0_len40_ik.npy")
joints = np.load("walk.npy")
def note(*pids):
    with open("generation/pids", "a") as file: file.write("".join("%d " % each for each in pids))
note(os.getpid())
"""
ENDS = (
    "np.save(path, joints)", "np.save(path, joints[:, :3])", "np.save(path, joints * np.nan)", "np.save(path, joints[:1])",
    "open(path, 'wb').write(os.urandom(3000))", "np.save(path, np.array([{}], dtype=object), allow_pickle=True)", "os.mkfifo(path)",
    "os.symlink('/dev/zero', path)", "sys.exit(3)", "sys.stderr.write('\\x1b[31m' * 9000); sys.exit(1)",
    "sys.stdout.buffer.write(os.urandom(200000)); sys.exit(1)", "os.kill(os.getpid(), signal.SIGSEGV)", "time.sleep(60)",
    "child = subprocess.Popen(['sleep', '60']); note(child.pid); time.sleep(60)", "os.chmod(folder, 0)",
    "signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(60)", "raise RuntimeError('no\\nweights')", "os.rmdir(folder)",
)  # fmt: skip


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One program and its call."""
    place = folder / "checkout"
    (place / "generation").mkdir(parents=True)
    walk = quick_walk().joints[:, :22][..., [1, 2, 0]].astype(np.float32)
    np.save(place / "walk.npy", np.repeat(walk, 10, axis=0)[:40])
    end = pick(rng, ENDS)
    (place / "gen_t2m.py").write_text(PROGRAM + end + "\n")
    prompt = pick(rng, ("a person walks", "a#b\n\0c", "$(touch escaped)", "-h", "é" * 2000))
    return Attempt(
        f"{end}: MoMask {prompt[:20]!r}", writing_only(lambda: _made(place, prompt), folder, "checkout/generation")
    )


def _made(place: Path, prompt: str) -> None:
    try:
        check_motion(MoMask(checkout=place, python=sys.executable, limit_s=3.0).generate(prompt, frames=40, seed=0))
    finally:
        noted = place / "generation" / "pids"
        check_gone([int(each) for each in noted.read_text().split()] if noted.exists() else [])
        left = [each.name for each in (place / "generation").iterdir() if each.name != "pids"]
        if left:
            raise Wrong(f"{left[0]} was left")
