"""Data sets of others: every value of a shard is checked against the recipe, and none leads out of a folder."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import yaml

from dataset_folder import recipe, write_dataset
from t2d_rt.core.errors import InputError
from t2d_rt.dataset import Dataset, check_dataset, export_dataset, make_dataset, read_split
from t2d_rt.dataset.shards import archive, content_hash, frozen_differences, recipe_of, sha256

Change = Callable[[dict[str, Any]], object]


@cache
def sound() -> dict[str, bytes]:
    """The files of a data set of two classes."""
    with TemporaryDirectory() as place:
        folder = write_dataset(Path(place) / "set", recipe(classes=["walking", "bending"]))
        return {str(each.relative_to(folder)): each.read_bytes() for each in folder.rglob("*") if each.is_file()}


def foreign(folder: Path, records: Callable[[list[Any]], Any] | None = None, arrays: Change | None = None) -> Path:
    """A data set whose maker changed the first shard and wrote a manifest that fits."""
    for name, data in sound().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    lines, packed = folder / "shards" / "00000.jsonl", folder / "shards" / "00000.npz"
    if records is not None:
        found = [json.loads(line) for line in lines.read_bytes().splitlines()]
        changed = records(found)
        lines.write_text(changed if isinstance(changed, str) else "".join(f"{json.dumps(each)}\n" for each in found))
    if arrays is not None:
        with np.load(packed) as file:
            kept: dict[str, Any] = dict(file)
        data = arrays(kept)
        packed.write_bytes(data if isinstance(data, bytes) else archive(kept))
    manifest = json.loads((folder / "manifest.json").read_bytes())
    manifest["files"] |= {each.name: sha256(each.read_bytes()) for each in (lines, packed)}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


def set_first(**changes: Any) -> Callable[[list[Any]], None]:
    return lambda found: found[0].update(changes)


def told_first(product: str, **changes: Any) -> Callable[[list[Any]], None]:
    return lambda found: found[0]["products"][product].update(changes)


def header_only(
    shape: tuple[int, ...], dtype: str = "<f2", of: str = "spectrogram"
) -> Callable[[dict[str, Any]], bytes]:
    """A shard, an array of which tells of a shape that nothing follows."""

    def packed(arrays: dict[str, Any]) -> bytes:
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w") as out:
            for name, array in arrays.items():
                entry = io.BytesIO()
                if name == of:
                    about = {"descr": dtype, "fortran_order": False, "shape": shape}
                    np.lib.format.write_array_header_1_0(entry, about)
                else:
                    np.lib.format.write_array(entry, array)
                out.writestr(f"{name}.npy", entry.getvalue())
        return file.getvalue()

    return packed


RECORDS: dict[str, tuple[Callable[[list[Any]], Any], str]] = {
    "a class that leads out": (set_first(**{"class": "../../escape"}), "class must be walking"),
    "a whole path as class": (set_first(**{"class": "/tmp/escape"}), "class must be walking"),
    "another class of the recipe": (set_first(**{"class": "bending"}), "class must be walking"),
    "no class": (lambda found: found[0].pop("class") and None, "class must be a text"),
    "a class of lists": (set_first(**{"class": [["walking"]]}), "class must be a text"),
    "an index beyond": (set_first(index=10**9), "index must be an integer"),
    "an index of words": (set_first(index="../0"), "index must be an integer"),
    "an index twice": (set_first(index=2), "twice"),
    "a row beyond": (set_first(row=4), "a row is missing"),
    "a condition": (set_first(condition="../x"), "condition must be ellipsoids"),
    "a description": (set_first(description=99), "description must be"),
    "no distance": (set_first(distance_m=float("nan")), "distance_m must"),
    "no SNR": (lambda found: found[0].pop("snr_db") and None, "snr_db must be a number"),
    "a seed": (set_first(seed="x"), "seed must be"),
    "sources": (set_first(sources=7), "sources must be a list"),
    "a second person": (set_first(second_person=[1]), "second_person must be"),
    "no products": (set_first(products=None), "products must tell"),
    "speeds backwards": (told_first("spectrogram", velocity_mps=[4, -4]), "velocity_mps of spectrogram"),
    "speeds of nothing": (told_first("spectrogram", velocity_mps=[0, 0]), "velocity_mps of spectrogram must rise"),
    "endless time": (told_first("spectrogram", time_s=[0, float("inf")]), "time_s of spectrogram"),
    "a peak": (told_first("spectrogram", peak_db="loud"), "peak_db of spectrogram"),
    "a scale of nothing": (told_first("adc", greatest=0), "greatest of adc"),
    "a null line": (lambda _: "null\n", "must be an object"),
    "a list": (lambda _: "[]\n", "must be an object"),
    "half a line": (lambda _: '{"index":', "is no JSON"),
    "deep JSON": (lambda _: "[" * 100_000 + "]" * 100_000, "nested too deeply"),
}  # fmt: skip

ARRAYS: dict[str, tuple[Change, str]] = {
    "another size": (lambda of: of.update(spectrogram=of["spectrogram"][:, :8]), r"must be float16 of shape \(5, 16, 24\)"),
    "another type": (lambda of: of.update(spectrogram=of["spectrogram"].astype(float)), "spectrogram must be float16"),
    "too few": (lambda of: of.update(spectrogram=of["spectrogram"][:2]), "spectrogram must be float16"),
    "NaN": (lambda of: of.update(spectrogram=of["spectrogram"] * np.nan), "NaN or infinite"),
    "above the greatest": (lambda of: of.update(spectrogram=of["spectrogram"] + 100), "levels above 0 dB"),
    "none": (lambda of: of.pop("spectrogram"), "is damaged"),
    "objects": (header_only((5, 16, 24), "|O"), "must be float16"),
    "a shape as large as memory": (header_only((10**12, 16, 24)), "must be float16"),
    "nothing after the shape": (header_only((5, 16, 24)), "not as long as it tells"),
    "no archive": (lambda _: b"PK nothing", "is damaged"),
    "points without columns": (lambda of: of.update(points_0=of["points_0"][:, :2]), "points_0 must be float32"),
    "more points than memory has": (header_only((10**12, 6), "<f4", "points_0"), r"points_0 takes 2\.4e\+04 GB"),
    "points of no number": (lambda of: of.update(points_0=of["points_0"] * np.nan), "NaN or infinite"),
    "ADC of another radar": (lambda of: of.update(adc_0=of["adc_0"][:, :, :9]), "adc_0 must be float16"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "name"), [("records", name) for name in RECORDS] + [("arrays", name) for name in ARRAYS]
)
def test_what_is_not_of_the_recipe(kind: str, name: str, tmp_path: Path) -> None:
    change, sentence = {"records": RECORDS, "arrays": ARRAYS}[kind][name]
    folder = foreign(tmp_path / "set", **{kind: change})
    with pytest.raises(InputError, match=sentence):
        export_dataset(Dataset(folder), tmp_path / "out", "png" if kind == "records" else "npz")
    assert any("damaged" in each for each in check_dataset(folder))
    assert [each.name for each in tmp_path.iterdir()] == ["set"]


def test_an_unchanged_set_is_read(tmp_path: Path) -> None:
    folder = foreign(tmp_path / "set")
    assert check_dataset(folder) == []
    export_dataset(Dataset(folder), tmp_path / "out", "png")


def test_files_that_are_none(tmp_path: Path) -> None:
    """A pipe in the place of a shard is not waited for, and a manifest names no files elsewhere."""
    folder = foreign(tmp_path / "set")
    (folder / "shards" / "00000.npz").unlink()
    os.mkfifo(folder / "shards" / "00000.npz")
    with pytest.raises(InputError, match="is a pipe"):
        Dataset(folder).array(0, "spectrogram")
    assert any("is a pipe" in each for each in check_dataset(folder))
    for text in ('{"files": {"../../x": "0"}}', '{"files": 1}', "[" * 100_000, "null"):
        (folder / "manifest.json").write_text(text)
        with pytest.raises(InputError, match=r"manifest.json cannot be read"):
            Dataset(folder)


def test_parquet_of_others(tmp_path: Path) -> None:
    """The record of a row leads nowhere, and its array is as the recipe has it."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    whole = export_dataset(write_dataset(tmp_path / "set"), tmp_path / "out", "parquet")
    (path,) = (whole / "data").glob("*.parquet")
    table = pq.read_table(path)
    place = table.schema.get_field_index("record")
    for change, sentence in (
        ({"class": "../../x"}, "class must be"),
        ({"index": -1}, "index must be"),
        (None, "must be an obj"),
    ):
        rows = [json.loads(each) for each in table["record"].to_pylist()]
        rows[0] = None if change is None else rows[0] | change
        pq.write_table(table.set_column(place, "record", pa.array([json.dumps(each) for each in rows])), path)
        with pytest.raises(InputError, match=sentence):
            Dataset(whole)


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000, "null", '{"sides": {"a": [1e400]}, "apart": 3, "left_out": [], "shared": {}}',
        '{"sides": {"a": [null]}, "apart": ["seed"], "left_out": [], "shared": {}}', '{"sides": {"a": 5}, "apart": "seed"}',
    ],
)  # fmt: skip
def test_splits_of_others(text: str, tmp_path: Path) -> None:
    (tmp_path / "split.json").write_text(text)
    with pytest.raises(InputError, match=r"split\.json is no split"):
        read_split(tmp_path / "split.json", [])


def test_content_is_the_same_in_other_shards_and_a_frozen_one_is_compared(tmp_path: Path, run: Any) -> None:
    folders = [write_dataset(tmp_path / f"{size}", recipe(samples_per_shard=size), failed=(3,)) for size in (5, 2)]
    found = [content_hash(each, recipe_of(each), 12)[0] for each in folders]
    assert found[0] == found[1]
    due, samples = content_hash(folders[0], recipe_of(folders[0]), 7)
    assert (due == found[0], samples) == (False, 7)
    for frozen, told in (
        ([[7, due], [13, due]], []),
        ([[8, due]], ["the first 8 samples of .* are not those of tiny that are"]),
    ):
        (folders[0] / "recipe.yaml").write_text(recipe(frozen=frozen).to_yaml())
        notices = frozen_differences(folders[0], recipe_of(folders[0]))
        assert [bool(re.search(*pair)) for pair in zip(told, notices, strict=True)] == [True] * len(told)
    manifest, other = (json.loads((each / "manifest.json").read_text()) for each in folders)
    (folders[0] / "manifest.json").write_text(json.dumps(manifest | {"made_on": ["abacus, OpenBLAS Haswell"]}))
    code, out, _ = run("dataset", "check", str(folders[0]))
    assert code == 0  # another processor's samples are sound
    assert all(each in out for each in (found[0], "frozen", "made on 'abacus, OpenBLAS Haswell'"))
    made_on = ["abacus, OpenBLAS Haswell, NumPy AVX2", "quipu, OpenBLAS Haswell, NumPy AVX2"]
    for more, told in (([], False), (["abacus, OpenBLAS SkylakeX, NumPy AVX512_SPR"], True)):
        (folders[1] / "manifest.json").write_text(json.dumps(other | {"made_on": made_on + more}))
        code, out, _ = run("dataset", "check", str(folders[1]))
        sentence = "with 2 kinds of kernels ('OpenBLAS Haswell, NumPy AVX2', 'OpenBLAS SkylakeX, NumPy AVX512_SPR')"
        assert (code, sentence in out, "kinds of kernels" in out) == (0, told, told)


def test_a_data_set_of_an_older_version_is_read_and_not_gone_on_with(tmp_path: Path) -> None:
    folder = write_dataset(tmp_path / "old", recipe(moving_fractions=[0.5, 0.7]))
    lines = (folder / "recipe.yaml").read_text().splitlines()
    at = lines.index("moving_fractions:")
    (folder / "recipe.yaml").write_text("\n".join(lines[:at] + lines[at + 3 :]))  # a key that it did not have
    with pytest.raises(InputError, match="is not the recipe that the samples were made of"):
        Dataset(folder)
    manifest = json.loads((folder / "manifest.json").read_text())
    plain = yaml.safe_load((folder / "recipe.yaml").read_text())
    kept = {name: each for name, each in plain.items() if name not in ("name", "about", "frozen", "subjects", "sides")}
    kept["products"] = {name: each for name, each in plain["products"].items() if name != "truth"}
    old = hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()[:32]
    (folder / "manifest.json").write_text(json.dumps({**manifest, "recipe_hash": old}))
    dataset = Dataset(folder)
    assert (len(dataset), dataset.recipe.hash) == (12, old)
    assert check_dataset(folder) == []
    assert dataset.recipe.model_copy(update={"seed": 5}).hash == recipe(seed=5).hash  # not the one that is kept
    with pytest.raises(InputError, match="holds samples of another recipe"):
        make_dataset(recipe(), folder, workers=1)
