"""Trained networks as files: weights in safetensors, and a card in JSON. Nothing is unpickled."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, model_validator

from t2d_rt.core.checks import array, file_path, interval, positive, shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_bytes
from t2d_rt.learn.maps import LabelledMaps, checked_classes, checked_size
from t2d_rt.learn.models import build
from t2d_rt.learn.pytorch import require_learning
from t2d_rt.types.fields import Count, Fields, Number

if TYPE_CHECKING:
    from torch import Tensor, nn

WEIGHTS, CARD, STATE = "weights.safetensors", "card.json", "state.ckpt"
FORMAT = "t2d-rt model 1"
MOST_BYTES = 2_000_000_000
PICKLES = b"PK", b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05"
"""First bytes of files that torch.save or pickle wrote."""
BATCH = 64
BAND = 0.1
"""Relative difference of carriers from which a recording counts as being of another band."""
CELLS = 1.5
"""Ratio of the widths of Doppler cells from which a recording counts as being of another resolution."""
RANGE, CONTRAST_DB = (0.05, 0.95), 3.0
"""Quantiles of the contrasts in the training that are stored on a card, and tolerance beyond these [dB]."""


def contrasts_db(levels: np.ndarray) -> np.ndarray:
    """Contrast of each map [dB], (N,): its greatest cell relative to the median of its cells, which is mostly noise."""
    return -np.median(levels, axis=(1, 2))


def as_input(levels: np.ndarray, dynamic_range_db: float) -> Tensor:
    """Maps (N, speed, time) [dB below the greatest cell] as inputs (N, 1, speed, time), 1 at the greatest cell and 0 at the end of
    the range."""
    import torch

    return torch.from_numpy(np.clip(1.0 + levels / np.float32(dynamic_range_db), 0.0, 1.0).astype(np.float32))[:, None]


Seconds = Annotated[Number, Field(gt=0)]


class Card(Fields):
    """What a trained network can be used for: the axes of its maps, and its classes. Unknown entries of a file are ignored."""

    noun: ClassVar[str] = "card"
    model_config = ConfigDict(extra="ignore")

    model: str
    classes: Annotated[tuple[str, ...], AfterValidator(checked_classes)]
    size: Annotated[tuple[int, int], BeforeValidator(checked_size)]
    velocity_mps: tuple[Number, Number]
    """Centres of the first and the last speed cell [m/s]."""
    duration_s: Seconds
    dynamic_range_db: Annotated[Number, Field(gt=0, le=200)]
    seed: Count
    about: dict[str, Any] = Field(default_factory=dict)
    """How the network was trained."""

    @model_validator(mode="after")
    def _usable(self) -> Self:
        """Refuses speeds that do not rise, and entries about the training of a wrong type."""
        if not self.velocity_mps[0] < self.velocity_mps[1]:
            raise InputError("velocity_mps must rise")
        for name, unit in (("carriers_hz", "Hz"), ("cells_mps", "m/s")):
            for value in self.about.get(name, []):
                positive(name, value, unit=unit)
        if "contrast_db" in self.about:
            array("contrast_db", interval("contrast_db", self.about["contrast_db"], unit="dB"), unit="dB")
        if self.about.get("mti", "mean") not in (None, "mean", "none"):
            raise InputError(f"mti must be mean or none, got {shown(self.about['mti'])}")
        if not all(isinstance(text, str) for text in self.about.get("descriptions", [])):
            raise InputError("descriptions must be texts")
        return self

    @classmethod
    def of(
        cls, model: str, maps: LabelledMaps, dynamic_range_db: float, *, seed: int, about: Mapping[str, Any]
    ) -> Card:
        """The card of a network for such maps, including their contrast."""
        return cls(
            model=model,
            classes=maps.classes,
            size=maps.size,
            velocity_mps=(float(maps.velocity_mps[0]), float(maps.velocity_mps[-1])),
            duration_s=maps.duration_s,
            dynamic_range_db=dynamic_range_db,
            seed=seed,
            about={"contrast_db": np.quantile(contrasts_db(maps.levels), RANGE).round(2).tolist(), **about},
        )

    def unfamiliar(
        self,
        what: str,
        *,
        carrier_hz: float | None = None,
        cell_mps: float | None = None,
        levels: np.ndarray | None = None,
    ) -> list[str]:
        """Sentences on what the network was not trained for: another carrier, Doppler resolution or noise. What the card does not
        specify is not checked.

        what: noun for the sentences, as "the recording".
        levels: its maps, (N, speed, time) [dB below the greatest cell of each].
        """
        warnings = []
        carriers = [float(value) for value in self.about.get("carriers_hz", [])]
        if carrier_hz is not None and carriers and min(abs(carrier_hz / carrier - 1) for carrier in carriers) > BAND:
            carriers_ghz = ", ".join(f"{carrier / 1e9:g}" for carrier in carriers)
            warnings.append(
                f"{what} is of {carrier_hz / 1e9:g} GHz, the model was trained on {carriers_ghz} GHz; its maps differ in Doppler "
                "resolution, so do not trust the classes before a test at this carrier"
            )
        cells = [float(value) for value in self.about.get("cells_mps", [])]
        if cell_mps is not None and cells and not min(cells) / CELLS < cell_mps < max(cells) * CELLS:
            warnings.append(
                f"{what} has Doppler cells of {cell_mps:.3g} m/s, those of the training {min(cells):.3g} to {max(cells):.3g} m/s; "
                "choose n_window so that they are alike"
            )
        span = self.about.get("contrast_db")
        if levels is not None and len(levels) and span is not None:
            contrast = float(np.median(contrasts_db(levels)))
            if not span[0] - CONTRAST_DB < contrast < span[1] + CONTRAST_DB:
                warnings.append(
                    f"the greatest cells of {what} are {contrast:.0f} dB above the median of all, in nine of ten maps of the "
                    f"training {span[0]:.0f} to {span[1]:.0f} dB; train on maps of such noise"
                )
        return warnings

    def with_about(self, **more: Any) -> Card:
        """A copy of the card with further entries in `about`."""
        return self.model_copy(update={"about": {**self.about, **more}})

    def to_plain(self) -> dict[str, Any]:
        """The card as plain values for JSON."""
        return {"format": FORMAT, **dict(self)}

    @property
    def speeds_mps(self) -> tuple[float, float]:
        """Outer edges of the first and the last speed cell [m/s], rounded to 1e-6 m/s; they do not depend on the number of
        cells."""
        first, last = self.velocity_mps
        half = 0.5 * (last - first) / (self.size[0] - 1)
        return round(first - half, 6), round(last + half, 6)

    @property
    def axis_mps(self) -> np.ndarray:
        """Centres of the speed cells [m/s]."""
        return np.linspace(*self.velocity_mps, self.size[0])


@dataclass(frozen=True, slots=True)
class SavedModel:
    """A trained network and its card."""

    card: Card
    network: nn.Module

    def probabilities(self, levels: np.ndarray) -> np.ndarray:
        """Probability of each class, (N, K), for maps (N, speed, time) [dB below the greatest cell of each].

        Raises InputError for maps with other cells than those of the training, for NaN, and where the weights give NaN.
        """
        import torch

        if levels.ndim != 3 or levels.shape[1:] != self.card.size:
            cells = " x ".join(map(str, self.card.size))
            raise InputError(f"maps must have {cells} cells, as in training, got shape {levels.shape}; resize them")
        if not np.isfinite(levels).all():
            raise InputError("maps must be finite, got NaN or infinite levels; remove damaged samples first")
        if not len(levels):
            return np.zeros((0, len(self.card.classes)), dtype=np.float32)
        self.network.eval()
        with torch.no_grad():
            batches = [
                torch.softmax(self.network(as_input(levels[start : start + BATCH], self.card.dynamic_range_db)), dim=1)
                for start in range(0, len(levels), BATCH)
            ]
        probabilities = np.asarray(torch.cat(batches).numpy())
        if not np.isfinite(probabilities).all():
            raise InputError(
                f"the network {self.card.model} gives probabilities that are NaN; its weights are of a training that failed, train "
                "it again at a lower rate"
            )
        return probabilities


@dataclass(frozen=True, slots=True)
class Ensemble:
    """Several trained networks for the same classes and axes, whose probabilities are averaged."""

    members: tuple[SavedModel, ...]

    def __post_init__(self) -> None:
        if not self.members:
            raise InputError("an ensemble needs a trained network or more; give their folders")
        first = self.members[0].card
        for member in self.members[1:]:
            card = member.card
            treatment = first.about.get("mti", "mean"), card.about.get("mti", "mean")
            for quantity, expected, actual in (
                ("classes", first.classes, card.classes),
                ("speeds", first.speeds_mps, card.speeds_mps),
                ("duration", first.duration_s, card.duration_s),
                ("treatment of static echoes", *treatment),
            ):
                if expected != actual:
                    raise InputError(
                        f"networks that are averaged must be trained on maps alike, got {quantity} {expected} and {actual}; "
                        "train them on the same data set"
                    )

    @property
    def card(self) -> Card:
        """The card of the first network; its classes, speeds and duration are those of all."""
        return self.members[0].card

    def probabilities(self, levels: np.ndarray) -> np.ndarray:
        """Mean probabilities over the networks, (N, K), for maps (N, speed, time) [dB below the greatest cell of each] with the
        cells of all."""
        return self.mean_of([levels] * len(self.members))

    def mean_of(self, maps: Sequence[np.ndarray]) -> np.ndarray:
        """Mean probabilities over the networks, (N, K), for maps with each network's own cells and dynamic range, one array for
        each network."""
        probabilities = [member.probabilities(levels) for member, levels in zip(self.members, maps, strict=True)]
        return np.asarray(np.mean(probabilities, axis=0))


def write_model(folder: Path, saved: SavedModel) -> None:
    """Writes weights and card to a folder; the same training gives the same bytes of weights."""
    from safetensors.torch import save

    arrays = {name: tensor.detach().contiguous().clone() for name, tensor in saved.network.state_dict().items()}
    weights = save(arrays)
    content = {**saved.card.to_plain(), "weights_sha256": hashlib.sha256(weights).hexdigest()}
    for name, data in ((WEIGHTS, weights), (CARD, json.dumps(content, indent=1).encode() + b"\n")):
        temporary = folder / f"{name}.new"
        temporary.write_bytes(data)
        temporary.replace(folder / name)


def load_model(path: str | Path) -> SavedModel:
    """Reads a trained network from the folder to which training wrote it.

    Raises InputError where the folder holds none, where a file is a pickle, and where card and weights do not belong together.
    """
    folder = file_path("the folder of a model", path)
    refuse_pickle(folder)
    if not (folder / WEIGHTS).is_file() or not (folder / CARD).is_file():
        raise InputError(f"{folder} holds no trained model ({WEIGHTS} and {CARD}); t2d-rt train writes one")
    require_learning()
    refuse_pickle(folder / WEIGHTS)
    card, checksum = _read_card(folder / CARD)
    network = build(card.model, len(card.classes), card.size)
    weights = read_bytes(folder / WEIGHTS, limit=MOST_BYTES, noun="file of weights")
    try:
        from safetensors.torch import load

        network.load_state_dict(load(weights))
    except Exception as error:  # a damaged file may hold anything
        reason = " ".join(str(error).split())[:200]
        raise InputError(
            f"{folder / WEIGHTS} does not hold the weights of {card.model} ({reason}); train it again"
        ) from None
    if hashlib.sha256(weights).hexdigest() != checksum:
        raise InputError(f"{folder / WEIGHTS} is not the file that {folder / CARD} was written with; train it again")
    return SavedModel(card, network.eval())


def _read_card(path: Path) -> tuple[Card, str]:
    """A card, and the SHA-256 of its weights."""
    try:
        content = json.loads(read_bytes(path, limit=50_000_000, noun="card of a model"))
        if content["format"] != FORMAT:
            raise InputError(f"it is of format {content['format']!r}, this program reads {FORMAT!r}")
        return Card.model_validate(content), str(content["weights_sha256"])
    except KeyError as error:
        raise InputError(f"{path} is no card of a model (it lacks {error}); train it again") from None
    except (ValueError, TypeError, RecursionError) as error:
        raise InputError(f"{path} is no card of a model ({error}); train it again") from None


def refuse_pickle(path: Path) -> None:
    """Raises an InputError if a file is a pickle, as torch.save writes; reading it could execute anything."""
    if path.is_file():
        with path.open("rb") as file:
            head = file.read(2)
        if head in PICKLES:
            raise InputError(
                f"{path} is a pickle, which could run anything when it is read; give the folder of a model in safetensors"
            )


def read_state(path: Path, network: nn.Module) -> dict[str, Any]:
    """Reads the state of a stopped training, which must consist of plain numbers and tensors."""
    import torch

    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
        if state.keys() != {"history", "best", "network", "optimizer", "plateau"}:
            raise ValueError("it lacks a part")
        if not all(np.isfinite([row[name] for name in ("val_loss", "train_loss")]).all() for row in state["history"]):
            raise ValueError("its losses are no numbers")
        shapes = {name: tensor.shape for name, tensor in network.state_dict().items()}
        if {name: tensor.shape for name, tensor in state["best"].items()} != shapes:
            raise ValueError("it is of another network")
    except Exception as error:  # torch and zipfile may raise anything for a damaged file
        raise not_a_state(path, error) from None
    return dict(state)


def not_a_state(path: Path, error: BaseException) -> InputError:
    """The error for a state that is damaged, or of another program."""
    reason = " ".join(str(error).split()).split(". ")[0][:100] or type(error).__name__
    return InputError(f"{path} is no state of a training that can be read safely ({reason}); remove it to begin anew")
