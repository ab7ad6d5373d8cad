"""`train_model`: trains a network on maps, and writes weights, card, curves and figures to a folder; `TrainOptions`: how it is
trained."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field

from t2d_rt.core.checks import file_path
from t2d_rt.core.errors import InputError
from t2d_rt.dataset.lock import LOCK, locked
from t2d_rt.learn.augment import Augment
from t2d_rt.learn.maps import DYNAMIC_RANGE_DB, LabelledMaps, check_axes
from t2d_rt.learn.models import build
from t2d_rt.learn.pytorch import require_learning, torch_threads
from t2d_rt.learn.saved_models import STATE, WEIGHTS, Card, SavedModel, write_model
from t2d_rt.types.fields import Count, Fields, Number


class TrainOptions(Fields):
    """Options of training; by default those of the authors of Text2Doppler: Adam at 1e-3, a rate that falls on a plateau, early
    stopping."""

    noun: ClassVar[str] = "training"
    model_config = ConfigDict(use_attribute_docstrings=True)

    rate: Annotated[Number, Field(gt=0, le=10)] = 1e-3
    """Learning rate of Adam."""
    factor: Annotated[Number, Field(gt=0, lt=1)] = 0.1
    """Factor by which the rate falls when the validation loss no longer falls."""
    plateau: Annotated[Count, Field(ge=0, le=10_000)] = 5
    """Number of epochs without a lower loss after which the rate falls; with 10, as for early stopping, it would fall in the last
    epoch only."""
    patience: Annotated[Count, Field(ge=1, le=10_000)] = 10
    """Number of epochs without a lower loss after which training stops."""
    schedule: Literal["plateau", "cosine"] = "plateau"
    """"plateau" lowers the rate when the validation loss no longer falls, and stops; "cosine" raises it over a seventh of the
    epochs and lowers it to zero by a cosine over the others, all of which are run (Loshchilov and Hutter 2017)."""
    smoothing: Annotated[Number, Field(ge=0, le=0.5)] = 0.0
    """Label smoothing: probability that is distributed over all classes, so that no network becomes certain (Szegedy et al.
    2016)."""
    decay: Annotated[Number, Field(ge=0, le=10)] = 0.0
    """Weight decay in each step, relative to the rate (Loshchilov and Hutter 2019)."""
    epochs: Annotated[Count, Field(ge=1, le=10_000)] = 100
    """Greatest number of epochs."""
    batch: Annotated[Count, Field(ge=2, le=100_000)] = 64
    """Number of samples in a batch."""
    seed: Annotated[Count, Field(ge=0, le=2**31)] = 0
    """Seed of the weights, the order of the samples and the augmentations."""
    threads: Annotated[Count, Field(ge=1, le=256)] = 1
    """Number of threads of torch; with one, the same seed gives the same weights, bit for bit on one machine."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Number format of convolutions and matrix products in training; weights are kept in float32. With bfloat16 a processor that
    has AVX512_BF16 or AMX trains networks of pictures in half the time, and others take longer."""
    device: Literal["cpu", "gpu"] = "cpu"
    """Device on which it runs."""
    augment: Augment = Augment()
    """How samples are augmented during training; by default they are not."""

    def rate_of(self, epoch: int) -> float:
        """Learning rate in an epoch, for the schedule "cosine"."""
        rising = max(1, round(self.epochs / 7))
        if epoch < rising:
            return self.rate * (epoch + 1) / (rising + 1)
        return self.rate * 0.5 * (1.0 + math.cos(math.pi * (epoch - rising) / (self.epochs - rising)))


Progress = Callable[[float], None]
NOTE = "training.txt"
"""File with a hash of everything on which a training depends; until the first epoch has been stored, another training may replace
it."""


def train_model(
    name: str,
    train: LabelledMaps,
    val: LabelledMaps,
    options: TrainOptions | None = None,
    *,
    output: str | Path | None = None,
    dynamic_range_db: float = DYNAMIC_RANGE_DB,
    about: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> SavedModel:
    """Trains a network on maps of all classes; it has the weights of the epoch with the least validation loss.

    output: folder to write to. A run that was stopped there continues; one with another model, data or options is refused.
    about: further entries for the card, such as the hash of the recipe.

    Raises InputError where a class has no sample, where maps of training and validation have other axes, where the folder holds
    another training, and where the loss is no longer finite.
    """
    require_learning()
    import torch

    from t2d_rt.learn.epochs import fitted

    options = TrainOptions() if options is None else options
    train.checked_for_training()
    if val.classes != train.classes or val.size != train.size:
        raise InputError(f"the maps of the validation must be like those of the training, got {val!r} and {train!r}")
    check_axes(train, val)
    if options.device == "gpu" and not (torch.cuda.is_available() or torch.backends.mps.is_available()):
        raise InputError("device is gpu, but PyTorch finds none here; take device cpu")
    with torch_threads(options.threads):
        torch.manual_seed(options.seed)
        network = build(name, len(train.classes), train.size)
        if hasattr(network, "set_axes"):  # its features depend on speeds and times
            network.set_axes(train.velocity_mps, train.duration_s)
        details = {**(about or {}), "options": options.model_dump(mode="json")}
        card = Card.of(name, train, dynamic_range_db, seed=options.seed, about=details)
        with _begun(output, card, train, val) as folder:
            keep_at = None if folder is None else folder / STATE
            history, seconds = fitted(network, (train, val), options, dynamic_range_db, keep_at, progress)
            card = card.with_about(history=history, epochs=len(history), seconds_per_epoch=seconds)
            saved = SavedModel(card, network.eval())
            if folder is not None:
                write_model(folder, saved)
            return saved


@contextmanager
def _begun(output: str | Path | None, card: Card, train: LabelledMaps, val: LabelledMaps) -> Iterator[Path | None]:
    """The output folder, locked against other runs, with a note of what is trained in it; refuses one that holds another training
    or other files. None where nothing is written."""
    if output is None:
        yield None
        return
    folder = file_path("the folder of a model", output)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"cannot make the folder {folder}: {reason}; choose a writable place for the model") from None
    data = hashlib.sha256()
    for maps in (train, val):
        data.update(maps.levels.tobytes() + maps.labels.tobytes())
    content = json.dumps({"card": card.to_plain(), "data": data.hexdigest()}, sort_keys=True)
    digest = hashlib.sha256(content.encode()).hexdigest()
    with locked(folder):
        note, new_note = folder / NOTE, folder / f"{NOTE}.new"
        others = {path.name for path in folder.iterdir()} - {LOCK, note.name, new_note.name}
        if others and not note.exists():
            raise InputError(f"{folder} holds other files; choose an empty or a new folder")
        if others & {STATE, WEIGHTS} and note.read_text("utf-8").strip() != digest:
            raise InputError(f"{folder} holds a training of another model, data or options; choose another folder")
        new_note.write_text(digest + "\n", "utf-8")
        new_note.replace(note)
        yield folder
