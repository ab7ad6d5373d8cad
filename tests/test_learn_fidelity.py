"""The study of fidelity: its rungs are the twins' simulation, it goes on where it stopped, its steps are told with intervals."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import Command
from t2d_rt.core.errors import InputError
from t2d_rt.learn import fidelity, twins
from t2d_rt.learn.adapters.parrad import BINS, RADARS, ROWS
from t2d_rt.learn.fidelity import RUNGS, make_rungs, read_rungs, run_study, rungs, study, write_fidelity
from t2d_rt.learn.fidelity.report import fidelity_text, score
from t2d_rt.learn.transfer import Events, classical, scores
from t2d_rt.learn.transfer.classical import extra_trees
from t2d_rt.learn.twins import SENTENCES, TwinRecipe, twin

pytest.importorskip("torch", reason="PyTorch is not installed (extra [learn])")

RECIPE = TwinRecipe(per_class=3)


def made_up(recipe: TwinRecipe, index: int) -> dict[str, Any]:
    """An event whose class lights a bin of its own; the least rung shows every class alike."""
    rng = np.random.default_rng(index)
    label = recipe.classes[index % len(recipe.classes)]
    levels = rng.normal(-100, 1, (len(RUNGS), len(RADARS), ROWS, BINS))
    first = 70 + 10 * list(SENTENCES).index(label)
    levels[1:, :, 10:40, first : first + 10] += 25
    levels[0, :, 10:40, 70:80] += 25
    return {
        "levels": levels.astype(np.float16),
        "label": label,
        "sentence": "",
        "seconds": np.arange(1.0, len(RUNGS) + 1),
    }


@pytest.fixture
def events(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(rungs, "event", made_up)
    monkeypatch.setattr(classical, "TREES", 10)
    monkeypatch.setattr(scores, "RESAMPLINGS", 50)
    return make_rungs(RECIPE, tmp_path / "events")


def trees_alone(cell: study.Cell, train: Events, asked: list[Events]) -> list[np.ndarray]:
    """In place of both learners, to save time."""
    return [extra_trees(train, each, cell.seed) for each in asked]


def test_the_specular_rung_is_the_twin_bit_for_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    by_name = {each.name: each for each in RUNGS}
    few = tuple(by_name[name] for name in ("centre-clean", "specular-clean", "specular"))
    monkeypatch.setattr(rungs, "RUNGS", few)
    monkeypatch.setattr(rungs, "ROWS", ROWS // 8)
    monkeypatch.setattr(twins, "SPAN_S", twins.SPAN_S / 8)
    found = rungs.event(RECIPE, 0)
    expected = twin(replace(RECIPE, scene="free_space"), 0).levels_db.astype(np.float16)
    np.testing.assert_array_equal(found["levels"][2], expected)
    assert found["label"] == "walk"
    moving = np.s_[:, :, np.abs(np.arange(BINS) - BINS // 2) > 3]
    centre, clean, noisy = (found["levels"][place][moving].astype(float) for place in range(3))
    assert np.median(noisy) > np.median(clean) + 10
    assert not np.array_equal(centre, clean)
    assert np.all(found["seconds"] > 0)


def test_a_stopped_study_goes_on_and_tells_what_each_step_gains(
    events: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study, "_labels", trees_alone)
    before = (events / "00000.npz").stat().st_mtime_ns
    make_rungs(replace(RECIPE, per_class=4), events)  # more events join those that are there
    assert (events / "00000.npz").stat().st_mtime_ns == before
    assert len(read_rungs(events).seconds["mesh"]) == 20
    found = read_rungs(events, 15)
    real = found.maps["specular"]
    first = run_study(found, real, tmp_path / "cells")
    kept = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "cells").iterdir()}
    assert len(kept) == len(study.cells()) == 2 * len(RUNGS) * len(study.SEEDS)
    (tmp_path / "cells" / "mesh_extra-trees_1.json").unlink()
    again = run_study(found, real, tmp_path / "cells")
    assert sum((tmp_path / "cells" / name).stat().st_mtime_ns != each for name, each in kept.items()) == 1
    for key, outcome in first.outcomes.items():
        np.testing.assert_array_equal(outcome.simulated, again.outcomes[key].simulated)
    best, least = (score(first, name, study.TREES, "simulated") for name in ("mesh-room", "centre-clean"))
    assert best is not None
    assert least is not None
    assert best[0] > 0.95 > 0.5 > least[0]
    assert first.seconds["mesh-room"] == len(RUNGS) / 2  # of one radar
    text = write_fidelity(first, tmp_path, "Real: none.").read_text()
    everything = next(line for line in text.splitlines() if line.startswith("| everything") and "extra trees" in line)
    assert everything.count("gains: +0.") == 2
    same = next(line for line in text.splitlines() if line.startswith("| mesh against ellipsoids, room | extra trees"))
    assert same.count("undecided: ") == 2
    assert (tmp_path / "fidelity.png").stat().st_size > 10_000
    assert "| - |" in fidelity_text(replace(first, real=None), "No real events were at hand.")
    with pytest.raises(InputError, match="is of other events; choose another folder"):
        run_study(found, None, tmp_path / "cells")
    path = tmp_path / "cells" / "mesh_extra-trees_1.json"
    path.write_text(json.dumps({"stamp": ""}))
    with pytest.raises(InputError, match="is not what a study wrote there"):
        run_study(found, real, tmp_path / "cells")


def test_a_network_learns_from_a_rung(events: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "STEPS", 30)
    found = {name: Events.of(maps) for name, maps in read_rungs(events).maps.items()}
    said = study._said(study.Cell("mesh", study.NETWORK, 0), found, None)
    assert said["real"] is None
    truth = found["mesh"].labels[said["test"]]
    assert np.mean(truth == said["simulated"]) > 0.8


def test_refusals(events: Path, tmp_path: Path, run: Command) -> None:
    with pytest.raises(InputError, match="holds events of another recipe"):
        make_rungs(replace(RECIPE, seed=1), events)
    with pytest.raises(InputError, match="needs 3 simulated events of each class or more, one has 1"):
        run_study(read_rungs(events, 5), None, tmp_path / "cells")
    (events / "00001.npz").write_bytes(b"PK")
    with pytest.raises(InputError, match=r"00001\.npz is no event of this study"):
        read_rungs(events)
    with pytest.raises(InputError, match="holds no events"):
        read_rungs(tmp_path)
    for words, sentence in (
        (("benchmark", "fidelity"), "benchmark needs -o"),
        (("benchmark", "fidelity", "--scale", "tiny", "-o", "x"), "benchmark fidelity takes no --scale; leave it out"),
        (("benchmark", "models", "--real", "x.npz", "-o", "x"), "benchmark models takes no --real; leave it out"),
        (("benchmark", "fidelity", "--real", str(tmp_path / "none.npz"), "-o", "x"), "does not exist"),
        (("benchmark", "cells", "-o", "x"), "benchmark compares models, fidelity, conditions, got cells"),
    ):
        refused = run(*words)
        assert refused.code == 2, words
        assert sentence in refused.err


def test_more_events_or_none_that_are_real_have_cells_of_their_own(
    events: Path, run: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that the folder of a study may be given again."""
    used: list[str] = []
    monkeypatch.setattr(fidelity, "run_study", lambda found, real, folder, progress: used.append(folder.name))
    monkeypatch.setattr(fidelity, "write_fidelity", lambda found, folder, told: folder)
    for count in ("3", "4"):
        assert run("benchmark", "fidelity", "--per-class", count, "-o", str(events.parent)).code == 0
    assert used == ["cells-15", "cells-20"]
