"""Trained models of others: cards, weights and states changed. What is loaded gives probabilities that are numbers."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

from t2d_rt.learn import load_model
from t2d_rt.learn.models import build
from t2d_rt.learn.saved_models import CARD, STATE, WEIGHTS, Card, SavedModel, read_state, write_model
from validation.robustness.fuzz.case import DEEP, Attempt, chance, check_finite, corrupted, pick, replaced, writing_only


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One model and what loads it."""
    import torch

    place = folder / "model"
    place.mkdir()
    torch.set_num_threads(1)
    network = build("streaming", 2, (16, 16))
    card = Card(
        model="streaming", classes=("a", "b"), size=(16, 16), velocity_mps=(-4.0, 4.0), duration_s=5.0, dynamic_range_db=60.0,
        seed=0, about={"carriers_hz": [77e9], "mti": "mean", "descriptions": ["a"], "indices": {"test": [1]}},
    )  # fmt: skip
    if chance(rng, 0.1):
        with torch.no_grad():
            for each in network.parameters():
                each.mul_(pick(rng, (float("nan"), 1e30, float("inf"))))
    write_model(place, SavedModel(card, network))
    if chance(rng, 0.3):
        told = _state(rng, place, network)
        return Attempt(
            f"{told}: read_state", writing_only(lambda: read_state(place / STATE, network), folder, "nowhere")
        )
    told = pick(rng, (_card, _card, _weights))(rng, place)
    return Attempt(f"{told}: load_model", writing_only(lambda: _loaded(place), folder, "nowhere"))


def _loaded(place: Path) -> None:
    model = load_model(place)
    if np.prod(model.card.size) < 1e6:
        levels = -60 * np.random.default_rng(0).random((2, *model.card.size)).astype(np.float32)
        check_finite(model.probabilities(levels), "probabilities")


def _card(rng: np.random.Generator, place: Path) -> str:
    told, values = replaced(rng, json.loads((place / CARD).read_text()))
    (place / CARD).write_text(DEEP if chance(rng, 0.05) else json.dumps(values))
    return f"card: {told}"


def _weights(rng: np.random.Generator, place: Path) -> str:
    told, data = corrupted(rng, (place / WEIGHTS).read_bytes())
    (place / WEIGHTS).write_bytes(data)
    values = json.loads((place / CARD).read_text())
    values["weights_sha256"] = hashlib.sha256(data).hexdigest()
    (place / CARD).write_text(json.dumps(values))
    return f"weights: {told}"


def _state(rng: np.random.Generator, place: Path, network: object) -> str:
    import torch

    state = {
        "history": [{"val_loss": 1.0, "train_loss": 1.0}], "best": network.state_dict(), "plateau": {}, "network": {},  # type: ignore[attr-defined]
        "optimizer": {},
    }  # fmt: skip
    told, values = replaced(rng, state) if chance(rng, 0.7) else ("as written", state)
    if chance(rng, 0.1):
        told, values = "a path", {"history": Path("x")}
    torch.save(values, place / STATE)
    if chance(rng, 0.4):
        how, data = corrupted(rng, (place / STATE).read_bytes())
        told += f", {how}"
        (place / STATE).write_bytes(data)
    return f"state: {told}"
