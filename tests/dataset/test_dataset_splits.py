"""Splits: no description, source clip or seed on two sides; each kind of leak that is planted is found and named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from t2d_rt.core.errors import InputError
from t2d_rt.dataset import check_split, folds, read_split, source_clips, split, splits
from t2d_rt.dataset.splits import KINDS, leaks
from t2d_rt.motion.generate import motion_from_text

CLASSES = "walking", "falling"


def record(index: int, label: int, description: int, clips: tuple[str, ...] = ()) -> dict[str, Any]:
    return {
        "index": index, "class": CLASSES[label], "sentence": f"{CLASSES[label]} {description}", "seed": 100 + index,
        "sources": ["made for 'it', by auto", *(f"clip {each}.1 of {each}.bvh, 0.00 to 1.25 s" for each in clips), "mirrored"],
    }  # fmt: skip


def own_clips(count: int = 80) -> list[dict[str, Any]]:
    """Two samples of each description; two descriptions share a clip."""
    return [record(index, index % 2, index // 4, (f"{index % 2}_{index // 8}",)) for index in range(count)]


def shared_clips(count: int = 160) -> list[dict[str, Any]]:
    """Two of 14 clips in each sample, so that clips join all of them."""
    rng = np.random.default_rng(0)
    return [
        record(index, index % 2, index // 4, tuple(f"c{each}" for each in rng.choice(14, 2, replace=False)))
        for index in range(count)
    ]


def sides_of(records: list[dict[str, Any]], side: tuple[int, ...], name: str) -> set[str]:
    """Sentences, seeds or recordings on a side."""
    return {
        value
        for index in side
        for value in (source_clips(records[index]) if name == "sources" else [records[index][name]])
    }


def test_nothing_is_on_two_sides_and_nothing_is_lost() -> None:
    records = own_clips()
    found = split(records, seed=3)
    assert [*found.sides] == ["train", "val", "test"]
    assert sorted(index for side in found.sides.values() for index in side) == list(range(80))
    for name in ("sentence", "seed", "sources"):
        values = [value for side in found.sides.values() for value in sides_of(records, side, name)]
        assert len(set(values)) == len(values)
    assert found.left_out == ()
    assert found.shared == {}


def test_fractions_hold_in_every_class() -> None:
    records = own_clips(320)
    found = split(records, (0.5, 0.25, 0.25))
    for side, fraction in zip(found.sides.values(), (0.5, 0.25, 0.25), strict=True):
        for label in range(2):
            count = sum(records[index]["class"] == CLASSES[label] for index in side)
            assert count == pytest.approx(160 * fraction, abs=4)  # a group is four samples


def test_a_split_follows_from_its_seed() -> None:
    records = own_clips()
    assert split(records, seed=1) == split(records, seed=1)
    assert split(records, seed=1).sides != split(records, seed=2).sides


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"sentence": "walking 0"}, r"the split leaks: description 'walking 0' is in train and in test"),
        ({"seed": 100}, r"the split leaks: seed '100' is in train and in test"),
        (
            {"sources": ["clip 0_0.7 of 0_0.bvh, 3.00 to 4.00 s"]},  # another piece of the recording
            r"the split leaks: clip '0_0.bvh' is in train and in test",
        ),
    ],
)
def test_each_kind_of_leak_is_found(change: dict[str, Any], sentence: str) -> None:
    records = [record(0, 0, 0, ("0_0",)), record(1, 0, 1, ("0_1",))]
    sides = {"train": [0], "test": [1]}
    check_split(records, sides)
    records[1] |= change
    with pytest.raises(InputError, match=sentence):
        check_split(records, sides)
    (kind, *_), = leaks(records, sides)  # fmt: skip
    check_split(records, sides, apart=[each for each in KINDS if each != kind])


def test_a_sample_on_two_sides_or_unknown_is_found() -> None:
    records = own_clips(8)
    with pytest.raises(InputError, match=r"sample 3 is in train and in test; put it on one side"):
        check_split(records, {"train": [1, 3], "test": [3]})
    with pytest.raises(InputError, match=r"the split names sample 99, which the data set does not hold"):
        check_split(records, {"train": [1], "test": [99]})


def test_clips_that_join_all_samples_are_refused_and_the_ways_out_work() -> None:
    records = shared_clips()
    with pytest.raises(
        InputError, match=r"160 samples make 1 groups by description, clip, seed, the largest of 160.*leave_out"
    ):
        split(records)
    by_description = split(records, apart=("description", "seed"))
    assert by_description.left_out == ()
    assert by_description.shared == {"clip": len(leaks(records, by_description.sides, ["clip"]))}
    assert by_description.shared["clip"] > 5
    assert "clips on two sides" in str(by_description)
    left = split(records, (0.7, 0.3), leave_out=True)
    assert leaks(records, left.sides) == []
    kept = sum(map(len, left.sides.values()))
    assert 0 < len(left.left_out) == 160 - kept
    assert (
        kept > 0.4 * 160
    )  # at random, 0.7^2 + 0.3^2 of the samples' pairs of clips, and all four samples of a description


def test_no_side_lacks_a_class_whose_clips_are_few() -> None:
    """Each fall is made of two of six clips, as jumps are of the clips that ship."""
    rng = np.random.default_rng(0)
    records = [record(index, 0, index, (f"walk{index % 9}",)) for index in range(40)]
    records += [
        record(40 + index, 1, index, tuple(f"c{each}" for each in rng.choice(6, 2, replace=False)))
        for index in range(20)
    ]
    for seed in range(4):
        found = split(records, (0.7, 0.15, 0.15), leave_out=True, seed=seed)
        assert all(any(index >= 40 for index in side) for side in found.sides.values())
        assert len(found.left_out) <= 14


def test_a_split_that_leaks_is_not_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(splits, "grouped", lambda records, kinds: [[place] for place in range(len(records))])
    with pytest.raises(InputError, match="the split leaks: clip"):
        split(own_clips())


def test_folds_test_each_sample_once() -> None:
    records = own_clips()
    found = folds(records, 4)
    assert sorted(index for each in found for index in each.sides["test"]) == list(range(80))
    for each in found:
        assert set(each.sides["train"]) | set(each.sides["test"]) == set(range(80))
        check_split(records, each.sides)


def test_folds_leave_out_only_what_would_leak() -> None:
    records = shared_clips(240)
    for each in folds(records, 3, leave_out=True):
        check_split(records, each.sides)
        assert len(each.left_out) + sum(map(len, each.sides.values())) == 240
        for index in each.left_out:
            grown = (
                {**each.sides, "train": (*each.sides["train"], index)},
                {**each.sides, "test": (*each.sides["test"], index)},
            )
            assert any(leaks(records, sides) for sides in grown)


def test_a_split_is_written_and_read_and_checked(tmp_path: Any) -> None:
    records = own_clips()
    found = split(records)
    path = tmp_path / "split.json"
    path.write_text(found.to_json())
    assert read_split(path, records) == found
    changed = [each | {"sentence": "the same"} for each in records]
    with pytest.raises(InputError, match=r"the split leaks: description 'the same' is in train and in val and in test"):
        read_split(path, changed)
    path.write_text("{}")
    with pytest.raises(InputError, match=r"split.json is no split; make one with t2d-rt dataset split"):
        read_split(path, records)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"fractions": (0.5, 0.6)}, "add up to 1, got 0.5, 0.6"),
        ({"fractions": 3}, "fractions must be two or three numbers"),
        ({"fractions": (1.0, 0.0)}, "each above 0"),
        ({"apart": ("clips",)}, "unknown kind of leak 'clips'; did you mean clip?"),
        ({"apart": ()}, "apart names nothing"),
        ({"seed": -1}, "seed must be an integer"),
        ({"leave_out": 1}, "leave_out must be True or False"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        split(own_clips(), **options)


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(
        InputError, match=r"and val would lack falling; take more samples, fewer sides or other fractions"
    ):
        split(own_clips(8), apart=("description",))
    with pytest.raises(InputError, match="no samples to split"):
        split([])


def test_clips_of_composed_motions_are_known() -> None:
    """The clips stand in the origin of a motion as texts: should their wording change, no leak would be found."""
    motion = motion_from_text("A man walks straight ahead.", seed=0, duration_s=2.0)
    told = [
        each for each in motion.origin if "clip " in each and ", by " not in each and "times the clips'" not in each
    ]
    found = source_clips({"sources": motion.origin})
    assert told
    assert found == {each.split(" of ", 1)[1].rsplit(",", 1)[0] for each in told}
    assert all(each.endswith((".bvh.gz", ".bvh", ".npz")) for each in found)
    file = "walk, fast.bvh, sha256 " + "0" * 64
    assert source_clips({"sources": [file]}) == {"walk, fast.bvh"}


def test_sides_have_plain_names() -> None:
    with pytest.raises(InputError, match=r"named by letters, digits, - and _, got '\.\./up'"):
        check_split([], {"../up": []})


def test_clips_and_seed_of_a_second_person_are_held_apart() -> None:
    """A second person of one side may not have walked on the other: mutation: leave `second_person` out of `traits`."""
    second = {"sentence": "a man strolls", "seed": 7, "sources": ["clip walk_3.0 of walk_3.bvh.gz, 0.00 to 1.00 s"]}
    plain = {"class": "walking", "second_person": None}
    records = [
        {**plain, "index": 0, "sentence": "a", "seed": 1, "sources": second["sources"]},
        {**plain, "index": 1, "sentence": "b", "seed": 2, "sources": [], "second_person": second},
        {**plain, "index": 2, "sentence": "c", "seed": 7, "sources": []},
    ]
    with pytest.raises(InputError, match="clip"):
        check_split(records, {"train": [0], "test": [1]}, apart=("clip",))
    with pytest.raises(InputError, match="seed"):
        check_split(records, {"train": [1], "test": [2]}, apart=("seed",))
    check_split(records, {"train": [0], "test": [2]})
