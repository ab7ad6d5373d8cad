"""Training of background models; needs torch and vector-quantize-pytorch, the extra [learn]."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional
from vector_quantize_pytorch import VectorQuantize

from t2d_rt.core.checks import integer
from t2d_rt.core.errors import InputError, install
from t2d_rt.noise.background.model import BackgroundModel
from t2d_rt.noise.background.network import HALO, NATS_PER_UNIT, Architecture, decoded
from t2d_rt.noise.background.records import BackgroundRecord, common_grid
from t2d_rt.noise.background.speckle import correlations, normal_scores

DECAY, COMMITMENT = 0.99, 0.25
"""Decay of the moving averages of the code books, and weight of the commitment loss, as the authors of Text2Doppler chose them."""
OF_VARIANCE = 0.1
"""Fraction of the gradient of the variance that reaches the maps before the last layer."""
DEAD = 0.5
"""A code is replaced by one of the batch's vectors if it stands for fewer vectors of a batch than this, by the moving average."""


class Residual(nn.Module):
    """A residual block, x + conv1x1(relu(conv3x3(relu(x)))) (van den Oord et al. 2017)."""

    def __init__(self, channels: int, middle: int) -> None:
        super().__init__()
        self.inner = nn.Conv2d(channels, middle, 3, padding=1)
        self.outer = nn.Conv2d(middle, channels, 1)

    def forward(self, maps: Tensor) -> Tensor:
        """Maps (batch, channel, row, step)."""
        return maps + self.outer(functional.relu(self.inner(functional.relu(maps))))


class Encoder(nn.Module):
    """Encoder from levels in units of NATS_PER_UNIT (batch, padded bins, columns) to latent vectors (batch, step, latent)."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        channels = 1
        for first, _, times in reversed(architecture.stages):
            kernel, padding = (4, 2 + times), (1, 1)
            layers += [nn.Conv2d(channels, first, kernel, (2, times), padding), nn.ReLU()]
            channels = first
        layers.append(nn.Conv2d(channels, architecture.channels, 3, padding=1))
        layers += [Residual(architecture.channels, architecture.residual) for _ in range(architecture.blocks)]
        self.layers = nn.Sequential(*layers)
        self.gather = nn.Linear(architecture.channels * architecture.rows, architecture.latent)

    def forward(self, levels: Tensor) -> Tensor:
        """Latent vectors (batch, step, latent) for levels (batch, padded bins, columns)."""
        maps = functional.relu(self.layers(levels[:, None]))
        return self.gather(maps.flatten(1, 2).transpose(1, 2))


class Decoder(nn.Module):
    """Decoder from latent vectors (batch, step, latent) to the expected level of every cell and its variance."""

    def __init__(self, architecture: Architecture, profile: Tensor) -> None:
        super().__init__()
        self.size = architecture.channels, architecture.rows
        self.spread = nn.Linear(architecture.latent, architecture.channels * architecture.rows)
        self.blocks = nn.ModuleList(
            Residual(architecture.channels, architecture.residual) for _ in range(architecture.blocks)
        )
        self.times = [times for *_, times in architecture.stages]
        self.stages = nn.ModuleList(
            nn.Conv2d(channels, out, (3, 3 if times == 2 else 1), padding=(1, 1 if times == 2 else 0))
            for channels, out, times in architecture.stages
        )
        self.profile = nn.Parameter(profile)

    def forward(self, vectors: Tensor) -> tuple[Tensor, Tensor]:
        """Expected level [nat] and logarithm of its variance [nat^2], each (batch, padded bins, columns).

        Only a tenth of the gradient of the variance reaches the maps that both outputs use, since these shall serve the levels
        first.
        """
        maps = self.spread(vectors).transpose(1, 2).unflatten(1, self.size)
        for block in self.blocks:
            maps = block(maps)
        *before, last = self.stages
        for stage, times in zip(before, self.times, strict=False):
            wider = functional.interpolate(functional.relu(maps), scale_factor=(2.0, float(times)), mode="nearest")
            maps = stage(wider)
        maps, times, half = functional.relu(maps), self.times[-1], len(last.weight) // 2
        outputs = []
        for kernels, features in (
            (slice(None, half), maps),
            (slice(half, None), OF_VARIANCE * maps + (1 - OF_VARIANCE) * maps.detach()),
        ):
            out = functional.conv2d(features, last.weight[kernels], last.bias[kernels], padding=last.padding)
            batch, _, rows, columns = out.shape
            out = out.reshape(batch, 2, times, rows, columns).permute(0, 3, 1, 4, 2)
            outputs.append(out.reshape(batch, 2 * rows, times * columns))
        return outputs[0] * NATS_PER_UNIT + self.profile[0][:, None], outputs[1] + self.profile[1][:, None]


class Codec(nn.Module):
    """Encoder, vector quantisation and decoder."""

    def __init__(self, architecture: Architecture, profile: Tensor) -> None:
        super().__init__()
        self.encoder = Encoder(architecture)
        self.quantizer = VectorQuantize(
            dim=architecture.latent,
            codebook_dim=architecture.code_size,
            heads=architecture.heads,
            separate_codebook_per_head=architecture.heads > 1,
            codebook_size=architecture.codes,
            decay=DECAY,
            commitment_weight=COMMITMENT,
            kmeans_init=True,
            threshold_ema_dead_code=DEAD,
        )
        self.decoder = Decoder(architecture, profile)

    def forward(self, levels: Tensor, quantized: bool = True) -> tuple[Tensor, Tensor, Tensor]:
        """Expected level [nat], logarithm of its variance, and commitment loss."""
        vectors, commitment = self.encoder(levels), levels.new_zeros(1)
        if quantized:
            vectors, _, commitment = self.quantizer(vectors)
        return (*self.decoder(vectors), commitment.sum())


class Prior(nn.Module):
    """The prior: logits of each code, given all earlier steps (by a recurrent state) and the codes before it in its own step."""

    def __init__(self, architecture: Architecture, embedded: int = 12) -> None:
        super().__init__()
        heads, codes, mixed = architecture.heads, architecture.codes, architecture.mixed
        self.embedding = nn.Parameter(0.3 * torch.randn(heads, codes, embedded * heads))
        self.start = nn.Parameter(torch.zeros(embedded * heads))
        self.gru = nn.GRU(embedded * heads, architecture.hidden, batch_first=True)
        self.mixing = nn.Parameter(torch.randn(heads * mixed, architecture.hidden) / architecture.hidden**0.5)
        self.mixing_bias = nn.Parameter(torch.zeros(heads, mixed))
        self.among = nn.Parameter(0.1 * torch.randn(heads, codes, heads, mixed))
        self.register_buffer("later", torch.ones(heads, heads).triu(1)[:, None, :, None])
        self.readout = nn.Parameter(torch.randn(heads, codes, mixed) / mixed**0.5)
        self.readout_bias = nn.Parameter(torch.zeros(heads, codes))

    def forward(self, codes: Tensor, dropout: float = 0.0) -> Tensor:
        """Logits (batch, step, head, code) for codes (batch, step, head)."""
        batch, _, heads = codes.shape
        head = torch.arange(heads)
        embedded = self.embedding[head, codes].sum(dim=2)
        inputs = torch.cat([self.start.expand(batch, 1, -1), embedded[:, :-1]], dim=1)
        state, _ = self.gru(functional.dropout(inputs, dropout))
        units = (functional.dropout(state, dropout) @ self.mixing.T).unflatten(
            2, self.mixing_bias.shape
        ) + self.mixing_bias
        units = units + (self.among * self.later)[head, codes].sum(dim=2)
        return torch.einsum("bthm,hcm->bthc", functional.relu(units), self.readout) + self.readout_bias

    def arrays(self) -> dict[str, Tensor]:
        """The weights that the sampler in NumPy uses; the effect of codes on earlier heads is set to zero."""
        return {**{name: parameter for name, parameter in self.named_parameters()}, "among": self.among * self.later}


NATS_PER_DB = float(np.log(10) / 10)
TILE_STEPS = 12
"""Steps of a training tile whose cells count in the loss; HALO more on either side are context."""
BATCH, PRIOR_BATCH = 6, 16
RATE = 1e-3
"""Learning rate of Adam, as the authors of Text2Doppler chose it; it falls to zero by half a cosine."""
WARM_STEPS = 100
UNQUANTIZED, FIRST_BATCHES = 0.3, 16
"""Fraction of the codec's steps before vectors are quantised, and number of batches whose clusters initialise the code books. (The
vectors of an untrained encoder are nearly equal, and code books initialised by them end with a single code in use.)"""
DROPOUT = 0.2
CHECK_EVERY = 25
VALIDATION = 0.15
"""Fraction of the records, or of the end of each record if there are few, on which the prior is selected."""
SAMPLES = 96
"""Number of samples, each as long as a record, from which the profile is adjusted."""
Progress = Callable[[float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Training:
    """Length and seed of a training run."""

    codec_steps: int = 800
    prior_steps: int = 400
    seed: int = 0


def train(
    records: list[BackgroundRecord], architecture: Architecture, training: Training, progress: Progress | None = None
) -> BackgroundModel:
    """Trains a model on these records; the result is the same for the same seed on one machine."""
    grid = common_grid(records)
    before = torch.get_num_threads()
    state = torch.random.get_rng_state()
    torch.set_num_threads(1)  # sums have the same bits with any number of cores
    torch.manual_seed(training.seed)
    rng = np.random.default_rng(training.seed)
    try:
        levels = [record.relative_db * np.float32(NATS_PER_DB) for record in records]
        codec = _codec(levels, architecture, training, rng, progress)
        codes = [encoded(codec, architecture, level) for level in levels]
        prior, loss = _prior(codes, architecture, training, rng, progress)
    finally:
        torch.set_num_threads(before)
        torch.random.set_rng_state(state)
    arrays = {f"encoder.{name}": parameter for name, parameter in codec.encoder.named_parameters()}
    arrays |= {f"decoder.{name}": parameter for name, parameter in codec.decoder.named_parameters()}
    arrays |= {f"prior.{name}": parameter for name, parameter in prior.arrays().items()}
    arrays["codebook"] = codebook(codec, architecture)
    stored = {name: np.ascontiguousarray(array.detach().numpy(), np.float32) for name, array in arrays.items()}
    stored["speckle.time"], stored["speckle.doppler"] = _residuals(architecture, stored, levels, codes)
    about = {
        "records": len(records),
        "duration_s": round(sum(record.duration_s for record in records), 1),
        "codec_steps": training.codec_steps,
        "prior_steps": training.prior_steps,
        "seed": training.seed,
        "prior_nats": round(loss, 4),
    }
    model = BackgroundModel.of(
        architecture,
        stored,
        grid,
        levels_db=[round(record.level_db, 3) for record in records],
        carrier_hz=records[0].carrier_hz,
        calibrated=all(record.calibrated for record in records),
        about=about,
    )
    return _calibrated(model, levels)


def _codec(
    levels: list[np.ndarray],
    architecture: Architecture,
    training: Training,
    rng: np.random.Generator,
    progress: Progress | None,
) -> Codec:
    """Trains encoder, code books and decoder on random tiles of the records."""
    padded = [_padded(record_levels, architecture) for record_levels in levels]
    codec = Codec(architecture, torch.from_numpy(_profile(padded)))
    optimizer = torch.optim.Adam(codec.parameters(), lr=RATE)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, partial(_rate_factor, steps=training.codec_steps))
    width = (TILE_STEPS + 2 * HALO) * architecture.columns
    edge = HALO * architecture.columns
    first = int(UNQUANTIZED * training.codec_steps)
    codec.train()
    for step in range(training.codec_steps):
        tiles = torch.from_numpy(_tiles(padded, width, rng))
        quantized = step >= first
        if step == first:  # initialise the code books with the clusters of many vectors
            with torch.no_grad():
                batches = [torch.from_numpy(_tiles(padded, width, rng)) for _ in range(FIRST_BATCHES)]
                codec.quantizer(torch.cat([codec.encoder(batch / NATS_PER_UNIT) for batch in batches]))
        level, variance, commitment = codec(tiles / NATS_PER_UNIT, quantized)
        cells, level, variance = (maps[:, :, edge : width - edge] for maps in (tiles, level, variance))
        square = (cells - level) ** 2
        loss = square.mean() + 0.5 * (square.detach() * torch.exp(-variance) + variance).mean() + commitment
        _stepped(optimizer, schedule, loss)
        if progress is not None and step % 10 == 0:
            progress(0.8 * step / training.codec_steps)
    codec.eval()
    return codec


def _prior(
    codes: list[np.ndarray],
    architecture: Architecture,
    training: Training,
    rng: np.random.Generator,
    progress: Progress | None,
) -> tuple[Prior, float]:
    """Trains the prior and returns its best state on held-out codes, with its cross entropy there [nat per code]."""
    used, held_out = split_codes(codes)
    prior = Prior(architecture)
    optimizer = torch.optim.Adam(prior.parameters(), lr=RATE, weight_decay=1e-5)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, partial(_rate_factor, steps=training.prior_steps))
    length = min(len(code) for code in used)
    best, best_loss = {name: tensor.clone() for name, tensor in prior.state_dict().items()}, np.inf
    for step in range(training.prior_steps):
        prior.train()
        batch = torch.from_numpy(_stretches(used, length, rng))
        loss = _surprise_of_codes(prior, batch, DROPOUT)
        _stepped(optimizer, schedule, loss)
        if step % CHECK_EVERY == CHECK_EVERY - 1:
            prior.eval()
            with torch.no_grad():
                losses = [float(_surprise_of_codes(prior, torch.from_numpy(code)[None], 0.0)) for code in held_out]
            if np.mean(losses) < best_loss:
                best_loss = float(np.mean(losses))
                best = {name: tensor.clone() for name, tensor in prior.state_dict().items()}
            if progress is not None:
                progress(0.8 + 0.2 * step / training.prior_steps)
    prior.load_state_dict(best)
    prior.eval()
    return prior, best_loss


def _surprise_of_codes(prior: Prior, codes: Tensor, dropout: float) -> Tensor:
    """Mean cross entropy of the prior [nat per code]."""
    return nn.functional.cross_entropy(prior(codes, dropout).flatten(0, 2), codes.flatten())


def split_codes(codes: list[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Codes to train on, and codes to select by: whole records where there are eight or more, else the end of each."""
    if len(codes) >= 8:
        held_out = max(1, round(VALIDATION * len(codes)))
        return codes[:-held_out], codes[-held_out:]
    cuts = [max(1, round((1 - VALIDATION) * len(code))) for code in codes]
    pairs = list(zip(codes, cuts, strict=True))
    return [code[:cut] for code, cut in pairs], [code[cut:] for code, cut in pairs if cut < len(code)]


@torch.no_grad()
def encoded(codec: Codec, architecture: Architecture, levels: np.ndarray) -> np.ndarray:
    """Codes (step, head) for a record's levels [nat], without the steps at its ends, which lack context."""
    whole = levels.shape[1] // architecture.columns * architecture.columns
    padded = torch.from_numpy(_padded(levels[:, :whole], architecture))
    codec.eval()
    _, codes, _ = codec.quantizer(codec.encoder(padded[None] / NATS_PER_UNIT))
    return np.asarray(codes.reshape(-1, architecture.heads).numpy()[HALO:-HALO])


def codebook(codec: Codec, architecture: Architecture) -> Tensor:
    """Entries of the code books, (head, code, number)."""
    book = codec.quantizer.codebook
    return book.reshape(architecture.heads, architecture.codes, architecture.code_size)


def _residuals(
    architecture: Architecture, arrays: dict[str, np.ndarray], levels: list[np.ndarray], codes: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Correlations of the difference between the records and the decoder's output."""
    scores = []
    for level, code in zip(levels, codes, strict=True):
        if len(code) > 2 * HALO:
            mean, looks = decoded(architecture, arrays, code)
            start = 2 * HALO * architecture.columns
            ratio = np.exp(level[:, start : start + mean.shape[1]] - mean)
            scores.append(normal_scores(ratio, looks))
    time_correlation, doppler_correlation = correlations(scores)
    return time_correlation.astype(np.float32), doppler_correlation.astype(np.float32)


def _calibrated(model: BackgroundModel, levels: list[np.ndarray]) -> BackgroundModel:
    """The model with its mean profile adjusted, so that samples have the records' mean level in each bin; the prior does not draw
    codes exactly as often as they occur.

    Levels are adjusted, not powers: the mean power of a bin is dominated by the few records in which a mover has just that speed.
    """
    length = round(np.mean([level.shape[1] for level in levels]))
    drawn = [np.log(model.columns(length, seed=seed).power).mean(axis=1) for seed in range(SAMPLES)]
    profile = model.arrays["decoder.profile"].copy()
    profile[0, : model.architecture.bins] += np.mean([level.mean(axis=1) for level in levels], axis=0) - np.mean(
        drawn, axis=0
    )
    return replace(model, arrays={**model.arrays, "decoder.profile": profile})


def _profile(padded: list[np.ndarray]) -> np.ndarray:
    """Initial output of the decoder: for each bin the median over records of the level [nat], and of the logarithm of its variance,
    (2, padded bins).

    The mean over all cells would not do: the few records with a mover have most of the variance, and the noise floor of the others
    would keep fluctuating.
    """
    level = np.median([record.mean(axis=1) for record in padded], axis=0)
    variance = np.median([record.var(axis=1) for record in padded], axis=0)
    return np.stack([level, np.log(variance + 1e-4)]).astype(np.float32)


def _padded(levels: np.ndarray, architecture: Architecture) -> np.ndarray:
    """Levels padded to the number of Doppler bins of the networks, by repeating the last bin."""
    return np.pad(levels, ((0, architecture.padded_bins - architecture.bins), (0, 0)), mode="edge")


def _tiles(padded: list[np.ndarray], width: int, rng: np.random.Generator) -> np.ndarray:
    """Random tiles (batch, padded bins, width); records are drawn in proportion to their length."""
    room = np.array([record.shape[1] - width + 1 for record in padded])
    which = rng.choice(len(padded), size=BATCH, p=room / room.sum())
    starts = [int(rng.integers(room[k])) for k in which]
    return np.stack([padded[k][:, start : start + width] for k, start in zip(which, starts, strict=True)])


def _stretches(codes: list[np.ndarray], length: int, rng: np.random.Generator) -> np.ndarray:
    """Random sequences of codes (batch, length, head)."""
    which = rng.integers(len(codes), size=PRIOR_BATCH)
    starts = [int(rng.integers(len(codes[k]) - length + 1)) for k in which]
    return np.stack([codes[k][start : start + length] for k, start in zip(which, starts, strict=True)])


def _rate_factor(step: int, steps: int) -> float:
    """Factor on the learning rate: it rises over the first steps and falls to zero by half a cosine."""
    return min(1.0, (step + 1) / WARM_STEPS) * 0.5 * (1 + float(np.cos(np.pi * min(1.0, step / steps))))


def _stepped(optimizer: torch.optim.Optimizer, schedule: torch.optim.lr_scheduler.LambdaLR, loss: Tensor) -> None:
    """One step of the optimizer and of its learning rate schedule."""
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    schedule.step()


STEP_S = 0.05
"""Greatest duration of a step of the codes [s], unless columns are farther apart; the blades of a fan take about that time."""
MOST_HALVINGS = 5
LEAST_STEPS = 14
"""Least number of steps in each record: a tile, and something from which the prior can learn."""


def learn_background(
    records: list[BackgroundRecord],
    *,
    codes: int = 32,
    heads: int = 4,
    codec_steps: int = 800,
    prior_steps: int = 400,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> BackgroundModel:
    """Trains a background model on records, which must all have the same axes.

    codes: number of entries of each code book; more than the data can use have no effect (`t2d-rt background evaluate` prints the
        perplexity).
    heads: number of code books, each of which encodes a part of a step's latent vector.
    codec_steps, prior_steps: number of steps of Adam for codec and prior.
    seed: seed of the weights and of the order of the data.

    Raises InputError where records differ in their axes, where one is too short, and where PyTorch is not installed.
    """
    if not records:
        raise InputError("a background is learned from one recording or more, got none")
    grid = common_grid(records)
    halvings = 0
    while halvings < MOST_HALVINGS and grid.time_step_s * 2 ** (halvings + 1) <= STEP_S:
        halvings += 1
    architecture = Architecture(bins=len(grid.velocity_mps), codes=codes, heads=heads, time_halvings=max(1, halvings))
    least = (LEAST_STEPS + 2 * HALO) * architecture.columns
    for record in records:
        if record.power.shape[1] < least:
            raise InputError(
                f"{record.name} has {record.power.shape[1]} columns, and a background is learned from {least} or more "
                f"({least * grid.time_step_s:.3g} s) of each recording; leave it out, or give a longer one"
            )
    require_torch()
    from t2d_rt.noise.background.training import Training, train

    training = Training(
        codec_steps=integer("codec_steps", codec_steps, 1),
        prior_steps=integer("prior_steps", prior_steps, 1),
        seed=integer("seed", seed),
    )
    return train(records, architecture, training, progress)


def require_torch() -> None:
    """Raises an InputError where the packages for training are not installed."""
    try:
        import torch  # noqa: F401
        import vector_quantize_pytorch  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"training a background needs torch and vector-quantize-pytorch ({error}); {install('learn')}"
        ) from None
