"""Run MoMask as a provider: the user's own checkout and weights, as a process in the environment that they were installed in.

MoMask (Guo et al. 2024) writes for each prompt joints of HumanML3D's skeleton at 20 Hz, once as generated and once with its own
inverse kinematics of the feet (`_ik`), which is what is read.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import uuid
from dataclasses import dataclass, replace
from pathlib import Path

from t2d_rt.core.checks import file_path, integer, number
from t2d_rt.core.errors import InputError, printable
from t2d_rt.core.processes import NOT_ALLOWED, NOT_FOUND, run_guarded
from t2d_rt.motion.descriptions.slots import Description
from t2d_rt.motion.read import load_motion
from t2d_rt.types.motion import Motion

CHECKOUT_VARIABLE, PYTHON_VARIABLE = "T2D_MOMASK", "T2D_MOMASK_PYTHON"

SCRIPT = "gen_t2m.py"

FRAME_HZ = 20
FRAMES = 40, 196
"""Lengths that MoMask was trained on [frames of 20 Hz]; it makes tokens of four."""

SECONDS_PER_STEP = 4.0
"""Duration of each step of a description that says nothing about time."""

SECRETS = "KEY", "TOKEN", "SECRET", "PASSWORD"
"""Environment variables with these words in their names are not passed on to the process."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MoMask:
    """A checkout of MoMask with its weights, and the Python of its environment."""

    checkout: Path
    """Folder of `gen_t2m.py`; its weights are in `checkpoints/`."""
    python: str = "python"
    """Interpreter of MoMask's environment."""
    gpu: int = -1
    """Number of the GPU, -1 for the CPU."""
    limit_s: float = 600.0
    """Longest time that it may take [s]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "checkout", file_path("checkout", self.checkout))
        integer("gpu", self.gpu, -1, 64)
        number("limit_s", self.limit_s, 1.0, 1e6, unit="s")

    @classmethod
    def from_environment(cls) -> MoMask:
        """The checkout that T2D_MOMASK names, run by the Python that T2D_MOMASK_PYTHON names; raises an InputError without it."""
        folder = os.environ.get(CHECKOUT_VARIABLE, "")
        if not folder:
            raise InputError(
                f"provider momask needs a checkout of MoMask with its weights: set {CHECKOUT_VARIABLE} to its folder and "
                f"{PYTHON_VARIABLE} to the Python of its environment"
            )
        return cls(checkout=Path(folder), python=os.environ.get(PYTHON_VARIABLE) or "python")

    def __call__(self, description: Description, *, seed: int) -> Motion:
        """The motion that MoMask makes of a description's sentence."""
        sentence = description.sentence
        # Its file of prompts has one a line, with the number of frames behind a '#'.
        prompt = " ".join(sentence.replace("#", " ").split())
        frames = _frames(description)
        motion = self.generate(prompt, frames=frames, seed=seed)
        return motion.edited(f"MoMask for {printable(prompt)!r}, seed {seed}")

    def generate(self, prompt: str, *, frames: int, seed: int) -> Motion:
        """Run MoMask on one prompt and remove its folder of results; raises an InputError if MoMask fails."""
        script = self.checkout / SCRIPT
        if not script.is_file():
            raise InputError(f"'{self.checkout}' is no checkout of MoMask: it has no {SCRIPT}; set {CHECKOUT_VARIABLE}")
        name = f"t2d_{uuid.uuid4().hex}"
        results = self.checkout / "generation" / name
        try:
            with tempfile.TemporaryDirectory() as folder:
                prompts = Path(folder) / "prompts.txt"
                prompts.write_text(f"{prompt}#{frames}\n", encoding="utf-8")
                self._run(
                    [
                        *(self.python, SCRIPT, "--gpu_id", str(self.gpu), "--ext", name, "--text_path", str(prompts)),
                        *("--repeat_times", "1", "--seed", str(seed % 2**31)),
                    ],
                    [results, Path(folder)],
                )
            return _result(results, self.checkout)
        finally:
            shutil.rmtree(results, ignore_errors=True)

    def _run(self, command: list[str], temporary: list[Path]) -> None:
        """Runs the process; raises an InputError with its last words if it fails."""
        environment = {
            name: value for name, value in os.environ.items() if not any(word in name.upper() for word in SECRETS)
        }
        try:
            done = run_guarded(
                command, folder=self.checkout, env=environment, limit_s=self.limit_s, temporary=temporary
            )
        except subprocess.TimeoutExpired:
            raise InputError(
                f"MoMask took longer than {self.limit_s:g} s and was stopped; use a GPU or allow more time"
            ) from None
        if done.returncode == NOT_FOUND:
            raise InputError(
                f"MoMask's Python '{self.python}' was not found; set {PYTHON_VARIABLE} to the interpreter of its environment"
            )
        if done.returncode == NOT_ALLOWED:
            raise InputError(f"MoMask's Python '{self.python}' may not be run; check {PYTHON_VARIABLE}")
        if done.returncode != 0:
            lines = (done.stderr or done.stdout).decode("utf-8", "replace").strip().splitlines()
            last = printable(lines[-1][:300]) if lines else "it said nothing"
            raise InputError(
                f"MoMask failed with exit code {done.returncode}: {last}; run it by hand in '{self.checkout}'"
            )


def _frames(description: Description) -> int:
    """Length to ask for [frames]: the durations of steps that say one, and the usual one for those that do not."""
    said_s = sum(step.duration_s or 0.0 for step in description.steps)
    if said_s * FRAME_HZ > FRAMES[1]:
        raise InputError(f"MoMask makes motions of {FRAMES[1] / FRAME_HZ:g} s at most, got {said_s:g} s; ask for less")
    lasting_s = sum(step.duration_s or SECONDS_PER_STEP for step in description.steps)
    return min(max(round(lasting_s * FRAME_HZ), FRAMES[0]), FRAMES[1]) // 4 * 4


def _result(results: Path, checkout: Path) -> Motion:
    joint_files = sorted((results / "joints").glob("*/sample*_repeat*_len*.npy")) if results.is_dir() else []
    if not joint_files:
        raise InputError(
            f"MoMask ended without joints in '{results.relative_to(checkout)}'; run it by hand in '{checkout}' and see what it says"
        )
    planted_files = [path for path in joint_files if path.stem.endswith("_ik")]
    path = (planted_files or joint_files)[0]
    try:
        motion = load_motion(path)
    except InputError as error:
        raise InputError(f"MoMask's joints cannot be used: {error}") from None
    return replace(motion, origin=())
