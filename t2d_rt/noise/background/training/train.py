"""Training of a background model on records: first the codec, then the prior over the codes of all records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor, nn

from t2d_rt.noise.background.architecture import HALO, Architecture
from t2d_rt.noise.background.decoder import NATS_PER_UNIT, decoded
from t2d_rt.noise.background.model import BackgroundModel
from t2d_rt.noise.background.records import BackgroundRecord, common_grid
from t2d_rt.noise.background.speckle import correlations, normal_scores
from t2d_rt.noise.background.training.networks import Codec, Prior

NATS_PER_DB = float(np.log(10) / 10)
TILE_STEPS = 12
"""Steps of a tile whose cells count, beside HALO more on either side as context."""
BATCH, PRIOR_BATCH = 6, 16
RATE = 1e-3
"""Learning rate of Adam, as the authors of Text2Doppler have it; it falls to nothing by half a cosine."""
WARM_STEPS = 100
UNQUANTIZED, FIRST_BATCHES = 0.3, 16
"""Fraction of the codec's steps before vectors are quantised, and batches whose clusters the code books begin with: an untrained
encoder's vectors hardly differ, and code books that begin with them end with one code in use."""
DROPOUT = 0.2
CHECK_EVERY = 25
SAMPLES = 96
"""By which the profile is set, each as long as a record."""
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Training:
    """How long and from which seed."""

    codec_steps: int = 800
    prior_steps: int = 400
    seed: int = 0
    validation: float = 0.15
    """Fraction of the records, or of each record's end where there are few, by which the prior is chosen."""
    threads: int = 1
    """Of torch; sums come out alike on any machine with one."""


def train(
    records: list[BackgroundRecord], architecture: Architecture, training: Training, progress: Progress | None = None
) -> BackgroundModel:
    """A model of these records; the same one for the same seed and number of threads on one machine."""
    grid = common_grid(records)
    before = torch.get_num_threads()
    state = torch.random.get_rng_state()
    torch.set_num_threads(training.threads)
    torch.manual_seed(training.seed)
    rng = np.random.default_rng(training.seed)
    try:
        levels = [each.relative_db * np.float32(NATS_PER_DB) for each in records]
        codec = _codec(levels, architecture, training, rng, progress)
        codes = [encoded(codec, architecture, each) for each in levels]
        prior, loss = _prior(codes, architecture, training, rng, progress)
    finally:
        torch.set_num_threads(before)
        torch.random.set_rng_state(state)
    arrays = {f"encoder.{name}": each for name, each in codec.encoder.named_parameters()}
    arrays |= {f"decoder.{name}": each for name, each in codec.decoder.named_parameters()}
    arrays |= {f"prior.{name}": each for name, each in prior.arrays().items()}
    arrays["codebook"] = codebook(codec, architecture)
    plain = {name: np.ascontiguousarray(each.detach().numpy(), np.float32) for name, each in arrays.items()}
    plain["speckle.time"], plain["speckle.doppler"] = _residuals(architecture, plain, levels, codes)
    about = {
        "records": len(records),
        "duration_s": round(sum(each.duration_s for each in records), 1),
        "codec_steps": training.codec_steps,
        "prior_steps": training.prior_steps,
        "seed": training.seed,
        "prior_nats": round(loss, 4),
    }
    model = BackgroundModel.of(
        architecture, plain, grid, levels_db=[round(each.level_db, 3) for each in records],
        carrier_hz=records[0].carrier_hz, calibrated=all(each.calibrated for each in records), about=about,
    )  # fmt: skip
    return _calibrated(model, levels)


def _codec(
    levels: list[np.ndarray], architecture: Architecture, training: Training, rng: np.random.Generator, progress: Progress | None
) -> Codec:  # fmt: skip
    padded = [_padded(each, architecture) for each in levels]
    codec = Codec(architecture, torch.from_numpy(_profile(padded)))
    optimizer = torch.optim.Adam(codec.parameters(), lr=RATE)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, _falling(training.codec_steps))
    width = (TILE_STEPS + 2 * HALO) * architecture.columns
    edge = HALO * architecture.columns
    first = int(UNQUANTIZED * training.codec_steps)
    codec.train()
    for step in range(training.codec_steps):
        tiles = torch.from_numpy(_tiles(padded, width, rng))
        quantized = step >= first
        if step == first:  # the code books begin with the clusters of many vectors
            with torch.no_grad():
                batches = [torch.from_numpy(_tiles(padded, width, rng)) for _ in range(FIRST_BATCHES)]
                codec.quantizer(torch.cat([codec.encoder(each / NATS_PER_UNIT) for each in batches]))
        level, variance, commitment = codec(tiles / NATS_PER_UNIT, quantized)
        cells, level, variance = (each[:, :, edge : width - edge] for each in (tiles, level, variance))
        square = (cells - level) ** 2
        loss = square.mean() + 0.5 * (square.detach() * torch.exp(-variance) + variance).mean() + commitment
        _stepped(optimizer, schedule, loss)
        if progress is not None and step % 10 == 0:
            progress(0.8 * step / training.codec_steps)
    codec.eval()
    return codec


def _prior(
    codes: list[np.ndarray], architecture: Architecture, training: Training, rng: np.random.Generator, progress: Progress | None
) -> tuple[Prior, float]:  # fmt: skip
    """The prior that is best on the codes that it was not trained on, and its surprise there [nat per code]."""
    used, kept = split_codes(codes, training.validation)
    prior = Prior(architecture)
    optimizer = torch.optim.Adam(prior.parameters(), lr=RATE, weight_decay=1e-5)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, _falling(training.prior_steps))
    length = min(len(each) for each in used)
    best, best_loss = {name: each.clone() for name, each in prior.state_dict().items()}, np.inf
    for step in range(training.prior_steps):
        prior.train()
        some = torch.from_numpy(_stretches(used, length, rng))
        loss = _surprise_of_codes(prior, some, DROPOUT)
        _stepped(optimizer, schedule, loss)
        if step % CHECK_EVERY == CHECK_EVERY - 1:
            prior.eval()
            with torch.no_grad():
                found = [float(_surprise_of_codes(prior, torch.from_numpy(each)[None], 0.0)) for each in kept]
            if np.mean(found) < best_loss:
                best_loss = float(np.mean(found))
                best = {name: each.clone() for name, each in prior.state_dict().items()}
            if progress is not None:
                progress(0.8 + 0.2 * step / training.prior_steps)
    prior.load_state_dict(best)
    prior.eval()
    return prior, best_loss


def _surprise_of_codes(prior: Prior, codes: Tensor, dropout: float) -> Tensor:
    """Per code [nat]."""
    return nn.functional.cross_entropy(prior(codes, dropout).flatten(0, 2), codes.flatten())


def split_codes(codes: list[np.ndarray], fraction: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Codes to train on and to choose by: whole records where there are eight or more, else the end of each."""
    if len(codes) >= 8:
        kept = max(1, round(fraction * len(codes)))
        return codes[:-kept], codes[-kept:]
    cuts = [max(1, round((1 - fraction) * len(each))) for each in codes]
    pairs = list(zip(codes, cuts, strict=True))
    return [each[:cut] for each, cut in pairs], [each[cut:] for each, cut in pairs if cut < len(each)]


@torch.no_grad()
def encoded(codec: Codec, architecture: Architecture, levels: np.ndarray) -> np.ndarray:
    """Codes (step, head) of a record's levels [nat], without those at its ends, which lack context."""
    whole = levels.shape[1] // architecture.columns * architecture.columns
    padded = torch.from_numpy(_padded(levels[:, :whole], architecture))
    codec.eval()
    _, codes, _ = codec.quantizer(codec.encoder(padded[None] / NATS_PER_UNIT))
    return np.asarray(codes.reshape(-1, architecture.heads).numpy()[HALO:-HALO])


def codebook(codec: Codec, architecture: Architecture) -> Tensor:
    """Entries (head, code, number)."""
    book = codec.quantizer.codebook
    return book.reshape(architecture.heads, architecture.codes, architecture.code_size)


def _residuals(
    architecture: Architecture, arrays: dict[str, np.ndarray], levels: list[np.ndarray], codes: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Correlations of what the decoder leaves of the records."""
    scores = []
    for each, code in zip(levels, codes, strict=True):
        if len(code) > 2 * HALO:
            mean, looks = decoded(architecture, arrays, code)
            start = 2 * HALO * architecture.columns
            ratio = np.exp(each[:, start : start + mean.shape[1]] - mean)
            scores.append(normal_scores(ratio, looks))
    time_correlation, doppler_correlation = correlations(scores)
    return time_correlation.astype(np.float32), doppler_correlation.astype(np.float32)


def _calibrated(model: BackgroundModel, levels: list[np.ndarray], samples: int = SAMPLES) -> BackgroundModel:
    """The model whose samples have the records' mean level in each bin: its prior draws codes not just as often as they are.

    Levels and not powers: the mean power of a bin is that of the few records in which a mover has just that speed.
    """
    length = round(np.mean([each.shape[1] for each in levels]))
    drawn = [np.log(model.columns(length, seed=seed).power).mean(axis=1) for seed in range(samples)]
    profile = model.arrays["decoder.profile"].copy()
    profile[0, : model.architecture.bins] += np.mean([each.mean(axis=1) for each in levels], axis=0) - np.mean(
        drawn, axis=0
    )
    return replace(model, arrays={**model.arrays, "decoder.profile": profile})


def _profile(padded: list[np.ndarray]) -> np.ndarray:
    """Where the decoder begins: level [nat] and logarithm of its variance, of each bin the median of the records, (2, padded bins).

    Not those of all cells: the few records with a mover have most of the variance, and the floor of the others would stay unsteady.
    """
    level = np.median([each.mean(axis=1) for each in padded], axis=0)
    variance = np.median([each.var(axis=1) for each in padded], axis=0)
    return np.stack([level, np.log(variance + 1e-4)]).astype(np.float32)


def _padded(levels: np.ndarray, architecture: Architecture) -> np.ndarray:
    return np.pad(levels, ((0, architecture.padded_bins - architecture.bins), (0, 0)), mode="edge")


def _tiles(padded: list[np.ndarray], width: int, rng: np.random.Generator) -> np.ndarray:
    """Random tiles (batch, padded bins, width), of records in proportion to their length."""
    room = np.array([each.shape[1] - width + 1 for each in padded])
    which = rng.choice(len(padded), size=BATCH, p=room / room.sum())
    starts = [int(rng.integers(room[k])) for k in which]
    return np.stack([padded[k][:, start : start + width] for k, start in zip(which, starts, strict=True)])


def _stretches(codes: list[np.ndarray], length: int, rng: np.random.Generator) -> np.ndarray:
    """Random stretches (batch, length, head)."""
    which = rng.integers(len(codes), size=PRIOR_BATCH)
    starts = [int(rng.integers(len(codes[k]) - length + 1)) for k in which]
    return np.stack([codes[k][start : start + length] for k, start in zip(which, starts, strict=True)])


def _falling(steps: int) -> Callable[[int], float]:
    return lambda step: min(1.0, (step + 1) / WARM_STEPS) * 0.5 * (1 + float(np.cos(np.pi * min(1.0, step / steps))))


def _stepped(optimizer: torch.optim.Optimizer, schedule: torch.optim.lr_scheduler.LambdaLR, loss: Tensor) -> None:
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    schedule.step()
