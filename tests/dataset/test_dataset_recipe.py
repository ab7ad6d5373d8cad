"""Recipes, the order of their samples, and the seeds of what is drawn."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import t2d_rt as t2d
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Recipe, recipe_names
from t2d_rt.dataset.sample import cell_of, sample
from t2d_rt.experiment.sources import MotionText

CONDITIONS = [{"name": "ellipsoids", "method": "ellipsoid"}, {"name": "mesh", "weight": 3}]
FIELDS: dict[str, Any] = {
    "name": "tiny", "classes": ["walking", "bending", "jumping"], "descriptions_per_class": 3, "samples_per_description": 2,
    "radar": "table2-uniform", "conditions": CONDITIONS,
}  # fmt: skip


def recipe(**changes: Any) -> Recipe:
    return Recipe(**{**FIELDS, **changes})


def test_recipes_that_ship() -> None:
    assert {
        "benchmark-3", "simple", "hard", "small-simple", "small-hard", "room-interference", "fidelity", "carriers",
    } == set(recipe_names())  # fmt: skip
    counts = {name: Recipe.read(name).samples for name in recipe_names()}
    assert counts["hard"] == counts["simple"] == 8 * 200 * 20
    assert counts["small-hard"] == counts["small-simple"] == 8 * 20 * 2
    assert {each.beside for each in Recipe.read("room-interference").conditions} == {
        "none", "fan", "curtain", "pet", "person",
    }  # fmt: skip
    carriers = [each.radar.carrier_hz for each in Recipe.read("carriers").conditions if each.radar]
    assert [round(each / 1e9) for each in carriers] == [24, 60, 77]


@pytest.mark.parametrize("name", ["small-hard", "carriers"])
def test_a_recipe_written_is_read_as_the_same(name: str, tmp_path: Path) -> None:
    first = Recipe.read(name)
    path = tmp_path / "recipe.yaml"
    path.write_text(first.to_yaml())
    again = Recipe.read(path)
    assert again == first
    assert again.hash == first.hash


@pytest.mark.parametrize(
    "changes",
    [
        {"seed": 1}, {"duration_s": 4.0}, {"noise": "none"}, {"radar": "table2"}, {"conditions": CONDITIONS[:1]},
        {"attempts": 2},
    ],
)  # fmt: skip
def test_the_hash_follows_what_samples_follow_from(changes: dict[str, Any]) -> None:
    assert recipe(**changes).hash != recipe().hash
    assert recipe(name="other", about="other words", frozen=[[3, "a" * 64]]).hash == recipe().hash


def test_the_first_samples_are_balanced_over_the_classes_and_differ_in_description() -> None:
    cells = [cell_of(recipe(), index) for index in range(9)]
    assert Counter(each.activity for each in cells) == {"walking": 3, "bending": 3, "jumping": 3}
    assert len({(each.activity, each.description) for each in cells}) == 9
    assert [each.repetition for each in cells] == [0] * 9
    assert cell_of(recipe(), 9).repetition == 1


def test_every_motion_and_every_index_once() -> None:
    cells = [cell_of(recipe(), index) for index in range(recipe().samples)]
    assert sorted(each.number for each in cells) == list(range(18))
    assert len({(each.activity, each.description, each.repetition) for each in cells}) == 18


def test_each_condition_records_the_same_motions() -> None:
    whole = recipe(each_condition=True)
    assert whole.samples == 36
    cells = [cell_of(whole, index) for index in range(36)]
    assert Counter((each.number, each.condition.name) for each in cells).most_common(1)[0][1] == 1
    assert cells[0].number == cells[3].number
    assert [cells[index].condition.name for index in (0, 3)] == ["ellipsoids", "mesh"]


def test_people_wear_and_carry_what_a_condition_says_and_move_alike_without() -> None:
    things = {"material": "dressed", "carries": ["bag in the left hand", {"thing": "ball", "size_m": [0.1]}]}
    conditions = [{"name": "plain"}, {"name": "loaded"} | things]
    whole = recipe(conditions=conditions, each_condition=True)
    plain, loaded = (sample(whole, index) for index in (0, 3))
    assert (plain.experiment.material, loaded.experiment.material) == (None, "dressed")
    alone, carrying = (each.experiment.targets[0] for each in (plain, loaded))
    assert isinstance(carrying, MotionText)
    assert alone == carrying.model_copy(update={"carries": ()})
    person = carrying.put(loaded.cut.motion, loaded.experiment.radar)
    assert [each.thing for each in person.carries] == ["bag", "ball"]
    assert (
        carrying.piece().joints.shape == person.joints.shape
    )  # by the sentence, which is kept without what is carried
    again = Recipe.model_validate_json(whole.model_dump_json())
    assert again == whole
    assert (
        again.hash == whole.hash != recipe(conditions=[{"name": "plain"}, {"name": "loaded"}], each_condition=True).hash
    )


def test_conditions_are_drawn_by_their_weights() -> None:
    many = recipe(samples_per_description=100)
    drawn = Counter(cell_of(many, index).condition.name for index in range(many.samples))
    assert drawn["mesh"] / many.samples == pytest.approx(0.75, abs=0.05)  # 900 draws: 0.014 is one standard deviation


def test_seeds_differ_by_purpose_number_and_recipe() -> None:
    first = recipe()
    found = {
        tuple(each.generate_state(2))
        for each in (
            first.seeds(0, "motion"), first.seeds(1, "motion"), first.seeds(0, "view"), recipe(seed=1).seeds(0, "motion"),
            recipe(attempts=2).seeds(0, "motion"),
        )
    }  # fmt: skip
    assert len(found) == 5
    assert np.array_equal(first.seeds(0, "motion").generate_state(2), recipe().seeds(0, "motion").generate_state(2))


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        (
            {"angles_deg": (30, -30)},
            r"angles_deg must be two numbers, least and greatest, within -360..360, got \[30, -30\]",
        ),
        ({"distances_m": (0.1, 3)}, "distances_m must be two numbers"),
        ({"classes": ["walking", "walking"]}, "classes names one of them twice"),
        ({"conditions": [CONDITIONS[0]] * 2}, "conditions names one of them twice"),
        ({"bodies": ["nobody"]}, "unknown body 'nobody'"),
        ({"products": {"spectrogram": None}}, "keeps nothing"),
        ({"conditions": [{"name": "Mesh it"}]}, "condition key name: got 'Mesh it', a name has up to 64 small letters"),
        ({"samples": 3}, "unknown recipe key 'samples'"),
        ({"radar": "table9"}, "unknown radar preset"),
        ({"background_level_db": -140}, "background_level_db belongs to a background"),
        (
            {"conditions": [{"name": "loaded", "carries": "cane"}]},
            "condition loaded has people carry a cane, which bending leaves no room for; give classes of walking, abn",
        ),
        ({"conditions": [{"name": "loaded", "carries": ["kite"]}]}, "unknown thing 'kite'"),
        (
            {"conditions": [{"name": "worn", "material": {"colour": 1}}]},
            "unknown field of a material or an outfit 'colour'",
        ),
    ],
)
def test_a_wrong_recipe_is_refused(changes: dict[str, Any], match: str) -> None:
    with pytest.raises(InputError, match=match):
        recipe(**changes)


def test_names_of_recipes(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"unknown recipe 'smal-hard'.*small-hard"):
        Recipe.read("smal-hard")
    (tmp_path / "mine.yaml").write_text("descriptions_per_class: 2\n")
    with pytest.raises(InputError, match=r"mine.yaml: recipe key .* is missing"):
        Recipe.read(tmp_path / "mine.yaml")
    with pytest.raises(InputError, match=r"the index of a sample must be an integer in 0\.\.17, got 18"):
        cell_of(recipe(), 18)


def test_files_that_a_recipe_names_are_found_from_its_folder_and_stay_so(tmp_path: Path) -> None:
    path = tmp_path / "recipe.yaml"
    scene = {"name": "own", "method": "ellipsoid", "scene": "rooms/own.xml"}
    path.write_text(recipe(conditions=[scene], background="own.safetensors").to_yaml())
    first = Recipe.read(path)
    assert first.conditions[0].scene == str(tmp_path / "rooms" / "own.xml")
    assert first.background == str(tmp_path / "own.safetensors")
    (tmp_path / "out").mkdir()
    stored = tmp_path / "out" / "recipe.yaml"
    stored.write_text(first.to_yaml())
    assert Recipe.read(stored).hash == first.hash
    assert set(first.files().values()) == {None}
    (tmp_path / "own.safetensors").write_bytes(b"weights")
    assert len(first.files()[str(tmp_path / "own.safetensors")] or "") == 64


def test_meshes_of_a_scene_are_among_the_files_that_samples_follow_from(tmp_path: Path) -> None:
    """An editor writes the same XML file and other meshes; mutation: take the XML file alone."""
    path = t2d.save_scene(t2d.Room(name="hall", size_m=(4.0, 4.0, 2.5)).scene(), tmp_path / "hall")
    found = recipe(conditions=[{"name": "own", "scene": str(path)}])
    before = found.files()
    (mesh, *_) = sorted((tmp_path / "hall" / "meshes").glob("*.ply"))
    mesh.write_bytes(mesh.read_bytes() + b"\0")
    after = found.files()
    assert [name for name in before if before[name] != after[name]] == [str(mesh.resolve())]
    mesh.unlink()
    with pytest.raises(InputError, match=r"hall.xml: it names .* which does not exist"):
        found.files()


def test_one_seed_of_noise_for_all_samples_is_refused() -> None:
    with pytest.raises(InputError, match="all samples would have the same noise"):
        recipe(noise={"seed": 5})


def test_bodies_may_have_a_body_mass_index() -> None:
    assert recipe(bodies=["man@31.5", "own"]).bodies == ("man@31.5", "own")
    with pytest.raises(InputError, match="body mass index of man"):
        recipe(bodies=["man@99"])
