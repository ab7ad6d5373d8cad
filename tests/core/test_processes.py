"""Programs that end with the process that started them, and what they give back."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from t2d_rt.core.processes import NOT_ALLOWED, NOT_FOUND, run_guarded


def guarded(code: str, place: Path, limit_s: float = 20.0) -> subprocess.CompletedProcess[bytes]:
    return run_guarded([sys.executable, "-c", code], folder=place, env=os.environ, limit_s=limit_s)


def test_what_a_program_says_and_how_it_ends(tmp_path: Path) -> None:
    found = guarded(
        "import os, sys; print(os.getcwd()); sys.stderr.write('e'); print(sys.stdin.read()); sys.exit(7)", tmp_path
    )
    assert (found.returncode, found.stdout.decode().split(), found.stderr) == (7, [str(tmp_path)], b"e")
    assert guarded("import os; os.kill(os.getpid(), 11)", tmp_path).returncode == 128 + 11
    for command, code in ((tmp_path / "none", NOT_FOUND), (tmp_path, NOT_ALLOWED)):
        assert run_guarded([str(command)], folder=tmp_path, env=os.environ, limit_s=20).returncode == code


@pytest.mark.slow
def test_a_program_that_takes_too_long_is_gone(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    kept.mkdir()
    with pytest.raises(subprocess.TimeoutExpired):
        run_guarded(
            [sys.executable, "-c", "import os, time; print(os.getpid(), file=open('pid', 'w'), flush=True); time.sleep(60)"],
            folder=tmp_path, env=os.environ, limit_s=3, temporary=[kept],
        )  # fmt: skip
    assert not Path(f"/proc/{(tmp_path / 'pid').read_text().strip()}").exists()
    assert not kept.exists()


def test_without_standard_streams(tmp_path: Path) -> None:
    """As where a shell has closed them, and a pipe takes their numbers."""
    code = (
        "import os, sys; from pathlib import Path; [os.close(each) for each in (0, 1, 2)]\n"
        "from t2d_rt.core.processes import run_guarded\n"
        "done = run_guarded([sys.executable, '-c', 'print(3)'], folder=Path.cwd(), env={}, limit_s=20)\n"
        "Path('said').write_bytes(done.stdout)"
    )
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
    assert (tmp_path / "said").read_text() == "3\n"
