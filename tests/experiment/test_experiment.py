"""Experiments: as YAML and JSON, and recordings made again from their folders alone."""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import t2d_rt as t2d
from builders import MOTIONS
from t2d_rt import cli
from t2d_rt.cli import main
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.scene import Slab
from validation.robustness.api_arguments import FACES, TETRAHEDRON, TIMES_S, egg, walk

RADAR = t2d.Radar.preset("ci4r", carrier_hz=24e9, prf_hz=2000, samples=32)
FAN = t2d.TableFan(position_m=(3, -1, 1), rpm=120)
FAST = {"radar": RADAR, "accuracy": {"sagitta_rad": 1.5}}


def tetrahedron() -> t2d.MovingMesh:
    away = TETRAHEDRON + [0.1, 0, 0] * np.arange(3)[:, None, None]
    return t2d.MovingMesh(away, FACES, TIMES_S, t2d.Material(relative_permittivity=3, scattering_coefficient=0.3))


def step() -> t2d.Motion:
    return t2d.trim(t2d.load_motion(MOTIONS / "12_01_walk.bvh"), 1, 1.1)


def room() -> t2d.Room:
    return t2d.Room(name="hut", size_m=(5, 4, 2.5), walls=Slab(material="concrete", thickness_m=0.2))


def from_yaml(folder: Path) -> t2d.Recording:
    path = folder / "experiment.yaml"
    path.write_text(
        f"targets:\n- {{kind: file, file: '{MOTIONS / '12_01_walk.bvh'}', stop_s: 0.2, distance_m: 3}}\n"
        "radar: ci4r\nmethod: ellipsoid\nseed: 3\n"
    )
    return t2d.run(t2d.Experiment.from_yaml(path))


MADE: dict[str, Callable[[Path], t2d.Recording]] = {
    "motion file": lambda _: t2d.simulate(step(), **FAST),
    "joints": lambda _: t2d.simulate(walk(), radar=RADAR, method="ellipsoid", phase_from="centre"),
    "arrays": lambda _: t2d.simulate([tetrahedron(), egg()], **FAST),
    "room": lambda _: t2d.simulate(tetrahedron(), scene=room(), reflections=1, **FAST),
    "movers": lambda _: t2d.simulate([FAN, tetrahedron(), FAN.mesh(0, 1)], **FAST),
    "array radar": lambda _: t2d.simulate(
        t2d.skin(t2d.place(step())),
        radar=t2d.Radar.preset("array-3x4", carrier_hz=24e9, samples=64),
        accuracy={"sagitta_rad": 1.5},
    ),
    "tolerance": lambda _: t2d.simulate(
        tetrahedron(), radar=RADAR, scene="empty_room", reflections=1, tolerance_db=-12
    ),
    "experiment in YAML": from_yaml,
}


@pytest.fixture(scope="module")
def made_twice(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[t2d.Recording, t2d.Recording]]:
    """Recordings, and what a fresh process makes of their folders alone, which have been moved elsewhere."""
    place, elsewhere = (tmp_path_factory.mktemp(name) for name in ("first", "elsewhere"))
    first = {}
    for number, (kind, make) in enumerate(MADE.items()):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", T2DWarning)
            first[kind] = make(place)
        first[kind].save(place / f"{number}.zarr")
        (place / f"{number}.zarr").rename(elsewhere / f"{number}.zarr")
    code = (
        "import t2d_rt as t2d, warnings; warnings.simplefilter('ignore')\n"
        f"for number in range({len(MADE)}): t2d.Recording.load(f'{{number}}.zarr').again().save(f'{{number}}_again.zarr')"
    )
    subprocess.run([sys.executable, "-c", code], cwd=elsewhere, check=True)
    again = [t2d.Recording.load(elsewhere / f"{number}_again.zarr") for number in range(len(MADE))]
    return {kind: (first[kind], again[number]) for number, kind in enumerate(MADE)}


@pytest.mark.slow
@pytest.mark.parametrize("kind", MADE)
def test_a_recording_is_made_again_from_its_folder_alone(
    kind: str, made_twice: dict[str, tuple[t2d.Recording, t2d.Recording]]
) -> None:
    first, again = made_twice[kind]
    np.testing.assert_array_equal(np.asarray(again.cube), np.asarray(first.cube))
    assert again.experiment == first.experiment
    assert again.accuracy == first.accuracy
    assert again.error_db == first.error_db


def test_experiments_and_accuracies_go_to_yaml_and_json_and_back() -> None:
    made = t2d.simulate([tetrahedron(), FAN], scene=room(), reflections=0, **FAST)
    experiment, accuracy = made.experiment, made.accuracy
    assert accuracy is not None
    for made_of in (experiment, accuracy):
        assert type(made_of).model_validate_json(made_of.model_dump_json()) == made_of
        assert type(made_of).model_validate(json.loads(json.dumps(made_of.model_dump(mode="json")))) == made_of
    assert experiment.hash == experiment.model_copy().hash
    assert experiment.hash != experiment.model_copy(update={"seed": 1}).hash


@pytest.mark.parametrize("changes", [{}, {"person_seed": 0}, {"person_seed": 3, "stand_s": 1.0, "carries": "bag"}])
def test_fields_of_newer_versions_are_written_where_they_differ_from_their_defaults(changes: dict[str, object]) -> None:
    target = {"kind": "text", "text": "a person walks", "seed": 4, **changes}
    made = t2d.Experiment(targets=[target], radar="table2")
    written = made.model_dump(mode="json")["targets"][0]
    assert {"person_seed", "stand_s", "radius_m", "carries"} & written.keys() == changes.keys()
    assert t2d.Experiment.model_validate_json(made.model_dump_json()) == made


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            '{"targets": [{"kind": "file", "file": "walk"}], "radar": "table2", "radar": "ci4r"}',
            "key 'radar' is given twice",
        ),
        ('{"targets": [', "the JSON text of an experiment cannot be read: Expecting value"),
        ("[" * 100_000, "the JSON text of an experiment cannot be read"),
        ("[1]", "an experiment must be a mapping of field names and values"),
        ('{"targets": [], "radar": "table2"}', "key targets is empty; give at least one"),
        (
            '{"targets": "walk", "radar": "table2"}',
            "key targets: got 'walk', write it as a list of mappings with a kind, as in [{kind: file",
        ),
        ('{"targets": ["walk"], "radar": "table2"}', "key targets: got 'walk', write it as a list"),
        ('{"targets": [{"file": "walk"}], "radar": "table2"}', "write it as a list of mappings with a kind"),
        ('{"targets": [{"kind": "fann"}], "radar": "table2"}', "unknown kind 'fann'; did you mean fan"),
        ('{"target": [], "radar": "table2"}', "unknown experiment key 'target'; did you mean targets"),
    ],
)
def test_json_that_is_refused(text: str, told: str) -> None:
    with pytest.raises(InputError, match=re.escape(told)):
        t2d.Experiment.model_validate_json(text)


@pytest.mark.slow
def test_a_plan_of_an_experiment_is_that_of_its_targets(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "experiment.yaml"
    text = f"targets: [{{kind: file, file: walk, stop_s: 0.2}}]\nradar: {RADAR.model_dump_json()}\n"
    path.write_text(f"{text}tolerance_db: -10\n")
    (tmp_path / "bare.yaml").write_text(text)
    planned = t2d.plan(t2d.Experiment.from_yaml(tmp_path / "bare.yaml"), tolerance_db=-10.0)
    direct = t2d.plan(t2d.trim(t2d.example("walk"), 0, 0.2), radar=RADAR, tolerance_db=-10.0)
    assert (planned.accuracy, planned.error_db) == (direct.accuracy, direct.error_db)
    assert main(["plan", str(path)]) == 0
    motion, *told = capsys.readouterr().out.splitlines()
    assert motion.startswith("BVH, 523 frames")
    assert told[:-1] == str(planned).splitlines()[:-1]
    for given, line in (((), "tolerance -10 dB"), (("--tolerance-db", "-20"), "tolerance -20 dB")):
        assert main(["plan", str(path), *given]) == 0
        assert capsys.readouterr().out.splitlines()[1].startswith(line)
    assert main(["plan", str(tmp_path / "bare.yaml")]) == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("tolerance -20 dB")
    assert main(["plan", str(path), "--scene", "living_room"]) == 2
    assert "option scene is part of the experiment" in capsys.readouterr().err
    assert main(["plan", "some.zarr"]) == 2
    assert "some.zarr is not a result folder" in capsys.readouterr().err
    with pytest.raises(InputError, match="option seed is part of the experiment"):
        t2d.plan(t2d.Experiment.from_yaml(tmp_path / "bare.yaml"), seed=3)


def test_experiments_to_a_yaml_file_and_back(tmp_path: Path) -> None:
    made = t2d.simulate([tetrahedron(), FAN], **FAST)
    (tmp_path / "a.yaml").write_text(made.experiment.to_yaml())
    assert t2d.Experiment.from_yaml(tmp_path / "a.yaml") == made.experiment


def test_a_bundled_motion_is_a_file_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "experiment.yaml"
    path.write_text("targets:\n- {kind: file, file: walk, start_s: 1, stop_s: 1.2}\nradar: ci4r\nmethod: ellipsoid\n")
    made = t2d.run(t2d.Experiment.from_yaml(path))
    path.write_text(path.read_text().replace("walk", str(MOTIONS / "12_01_walk.bvh")))
    assert np.array_equal(made.cube, t2d.run(t2d.Experiment.from_yaml(path)).cube)
    # A file of that name beside the experiment comes first, and what is neither is named.
    (tmp_path / "walk").write_text("no motion")
    path.write_text("targets: [{file: walk, kind: file}]\nradar: ci4r\n")
    with pytest.raises(InputError, match=r"cannot read .*/walk': motions come as"):
        t2d.run(t2d.Experiment.from_yaml(path))
    path.write_text("targets: [{file: wolk, kind: file}]\nradar: ci4r\n")
    with pytest.raises(InputError, match=r"no motion file .*wolk.* and no bundled motion of that name"):
        t2d.run(t2d.Experiment.from_yaml(path))


@pytest.mark.filterwarnings("ignore::t2d_rt.core.errors.T2DWarning")
def test_a_motion_is_made_from_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "said.yaml"
    said = "a person walks forward"
    path.write_text(
        f"targets:\n- {{kind: text, text: {said}, seed: 2, stop_s: 0.3, angle_deg: 20}}\nradar: ci4r\nmethod: ellipsoid\n"
    )
    recording = t2d.run(t2d.Experiment.from_yaml(path))
    radar = t2d.Radar.preset("ci4r")
    motion = t2d.place(t2d.trim(t2d.motion_from_text(said, seed=2), 0, 0.3), angle_deg=20)
    same = t2d.simulate(motion, radar=radar, method="ellipsoid")
    assert np.array_equal(recording.adc.values, same.adc.values)
    other = t2d.Experiment(targets=[{"kind": "text", "text": said, "seed": 3}], radar="ci4r")
    assert not np.array_equal(other.targets_from({})[0].joints[:9], motion.joints[:9])
    with pytest.raises(InputError, match="provider"):
        t2d.run(t2d.Experiment(targets=[{"kind": "text", "text": said, "provider": "magic"}], radar="ci4r"))


def test_a_folder_of_results_is_found_from_the_experiment_that_names_it(tmp_path: Path) -> None:
    motion = t2d.trim(t2d.example("walk"), 0, 1)
    (tmp_path / "made").mkdir()
    t2d.save_motion(motion, tmp_path / "made" / "one.bvh")
    (tmp_path / "made" / "one.txt").write_text("a person walks")
    path = tmp_path / "said.yaml"
    path.write_text("targets:\n- {kind: text, text: a person walks, provider: 'files:made'}\nradar: ci4r\n")
    (found,) = t2d.Experiment.from_yaml(path).targets_from({})
    assert isinstance(found, t2d.Motion)
    assert len(found.joints) == len(motion.joints)


def test_what_a_function_computes_cannot_be_made_again(tmp_path: Path) -> None:
    mesh = t2d.MovingMesh.from_track(lambda t: np.repeat(TETRAHEDRON[None], len(t), axis=0), FACES, [0, 0.2])
    t2d.simulate(mesh, **FAST).save(tmp_path / "a.zarr")
    with pytest.raises(InputError, match=r"cannot be made again: MovingMesh.* was computed by a function"):
        t2d.Recording.load(tmp_path / "a.zarr").again()


def test_a_measured_recording_cannot_be_made_again() -> None:
    measured = t2d.Recording(np.ones((4, 1, RADAR.samples), np.complex64), RADAR)
    with pytest.raises(
        InputError, match="was measured and has no experiment, so it cannot be simulated again; give an Experiment"
    ):
        measured.again()


def test_damaged_inputs_are_told(tmp_path: Path) -> None:
    t2d.simulate(tetrahedron(), **FAST).save(tmp_path / "a.zarr")
    (found,) = (tmp_path / "a.zarr" / "inputs").iterdir()
    data = bytearray(found.read_bytes())
    data[len(data) // 2] ^= 1
    found.write_bytes(bytes(data))
    with pytest.raises(InputError, match=r"damaged|not a whole file"):
        t2d.Recording.load(tmp_path / "a.zarr")


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"targets": []}, "experiment key targets"),
        ({"targets": [{"kind": "ghost"}]}, "experiment key targets"),
        ({"targets": [{"kind": "file", "file": "a.bvh", "speed": 3}]}, "unknown motion key 'speed'"),
        ({"targets": [{"kind": "file", "file": "a.bvh"}], "radar": "tableau2"}, "unknown radar preset 'tableau2'"),
        ({"targets": [{"kind": "file", "file": "a.bvh"}], "reflections": 9}, "experiment key reflections"),
        ({"targets": [{"kind": "file", "file": "a.bvh"}], "sene": "corridor"}, "did you mean scene"),
    ],
)
def test_a_wrong_field_is_named(fields: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        t2d.Experiment(**{"radar": "ci4r", **fields})


def test_an_experiment_and_a_result_again_on_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "walk.bvh").write_bytes((MOTIONS / "12_01_walk.bvh").read_bytes())
    (tmp_path / "set" / "mine.yaml").write_text(
        "targets:\n- {kind: file, file: walk.bvh, stop_s: 0.2}\nradar: ci4r\nmethod: ellipsoid\n"
        "accuracy: {surface_rate_hz: 70}\n"
    )
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "set/mine.yaml"]) == 0
    assert main(["simulate", "--again", "mine.zarr"]) == 0
    first, again = (t2d.Recording.load(f"{name}.zarr") for name in ("mine", "mine_again"))
    np.testing.assert_array_equal(np.asarray(first.cube), np.asarray(again.cube))
    assert first.accuracy.surface_rate_hz == 70
    assert main(["simulate", "set/mine.yaml", "--scene", "corridor", "--overwrite"]) == 2


def test_a_stored_motion_tells_where_it_comes_from() -> None:
    path = MOTIONS / "12_01_walk.bvh"
    walker = t2d.place(t2d.trim(t2d.load_motion(path), 1, 1.2), distance_m=3)
    made = t2d.simulate(walker, radar="table2", method="ellipsoid").experiment
    file, *edits = made.targets[0].origin
    assert file == f"12_01_walk.bvh, sha256 {hashlib.sha256(path.read_bytes()).hexdigest()}"
    assert edits[-2:] == ["cut to 1 to 1.2 s", walker.report.rpartition("; ")[2]]


class Wider(t2d.Accuracy):
    extra_rate_hz: float = 1.0
    """Rate of something new [Hz]."""


@pytest.mark.slow
def test_a_new_field_of_accuracy_needs_no_other_edit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is found in Python, YAML, the help of the command line and the attributes of a saved recording."""
    monkeypatch.setattr(
        "t2d_rt.cli._command", cli._command.__wrapped__
    )  # its options are not those that the session keeps
    for module in ("t2d_rt.types", "t2d_rt.accuracy.planning", "t2d_rt.recording.recording", "t2d_rt.recording.files"):
        monkeypatch.setattr(f"{module}.Accuracy", Wider)
    made = t2d.simulate(tetrahedron(), radar=RADAR, accuracy={"sagitta_rad": 1.5, "extra_rate_hz": 3})
    made.save(tmp_path / "a.zarr")
    loaded = t2d.Recording.load(tmp_path / "a.zarr").accuracy
    assert isinstance(loaded, Wider)
    assert loaded.extra_rate_hz == 3
    with pytest.raises(SystemExit):
        main(["simulate", "--help"])
    assert "Rate of something new [Hz]. By default it is 1.0." in " ".join(capsys.readouterr().out.split())
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(
        f"targets: [{{kind: file, file: '{MOTIONS / '12_01_walk.bvh'}', stop_s: 0.2}}]\n"
        "radar: table2\nmethod: ellipsoid\naccuracy: {extra_rate_hz: 5}\n"
    )
    assert main(["simulate", "mine.yaml"]) == 0
    assert json.loads(t2d.Recording.load("mine.zarr").attributes["accuracy"])["extra_rate_hz"] == 5
    assert main(["simulate", "mine.yaml", "--accuracy.extra-rate-hz=7", "--overwrite"]) == 0
    assert json.loads(t2d.Recording.load("mine.zarr").attributes["accuracy"])["extra_rate_hz"] == 7


def test_a_motion_file_is_read_as_its_experiment_says(tmp_path: Path) -> None:
    text = f"targets: [{{kind: file, file: '{MOTIONS / '12_01_walk.bvh'}', stop_s: 0.2%s}}]\nradar: ci4r\n"
    plain, scaled = tmp_path / "plain.yaml", tmp_path / "scaled.yaml"
    plain.write_text(text % "")
    scaled.write_text(text % ", reading: {units: 0.06, floor: 0}")
    experiments = [t2d.Experiment.from_yaml(path) for path in (plain, scaled)]
    statures = [each.targets_from({})[0].report.partition("1 unit = ")[2][:7] for each in experiments]
    assert statures == ["0.05644", "0.06 m "]
    assert (
        "reading" not in experiments[0].to_yaml()
    )  # as before there were any options of reading, and with the same hash
    assert experiments[0].hash != experiments[1].hash
    scaled.write_text(text % ", reading: {unit: cm}")
    with pytest.raises(InputError, match=r"unknown option of reading 'unit'; did you mean units\?"):
        t2d.Experiment.from_yaml(scaled)
