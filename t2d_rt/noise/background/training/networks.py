"""The networks in torch: encoder, decoder with vector quantisation between them, and the prior over the codes.

A VQ-VAE (van den Oord et al., Neural discrete representation learning, 2017) whose latent is one vector for each step in time,
quantised in parts (product quantisation), and whose decoder gives the expected level of each cell and its variance.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional
from vector_quantize_pytorch import VectorQuantize

from t2d_rt.noise.background.architecture import Architecture
from t2d_rt.noise.background.decoder import NATS_PER_UNIT

DECAY, COMMITMENT = 0.99, 0.25
"""Of the code books' moving averages, and weight of the commitment loss, as the authors of Text2Doppler have them."""
OF_VARIANCE = 0.1
"""Part of the variance's gradient that reaches the maps before the last layer."""
DEAD = 0.5
"""A code that stands for fewer vectors of a batch than that, by the moving average, is replaced by one of the batch's vectors."""


class Residual(nn.Module):
    """x + conv1x1(relu(conv3x3(relu(x))))."""

    def __init__(self, channels: int, middle: int) -> None:
        super().__init__()
        self.inner = nn.Conv2d(channels, middle, 3, padding=1)
        self.outer = nn.Conv2d(middle, channels, 1)

    def forward(self, maps: Tensor) -> Tensor:
        """Maps (batch, channel, row, step)."""
        return maps + self.outer(functional.relu(self.inner(functional.relu(maps))))


class Encoder(nn.Module):
    """From levels in units of NATS_PER_UNIT (batch, padded bins, columns) to latent vectors (batch, step, latent)."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        given = 1
        for first, _, times in reversed(architecture.stages):
            kernel, padding = (4, 2 + times), (1, 1)
            layers += [nn.Conv2d(given, first, kernel, (2, times), padding), nn.ReLU()]
            given = first
        layers.append(nn.Conv2d(given, architecture.channels, 3, padding=1))
        layers += [Residual(architecture.channels, architecture.residual) for _ in range(architecture.blocks)]
        self.layers = nn.Sequential(*layers)
        self.gather = nn.Linear(architecture.channels * architecture.rows, architecture.latent)

    def forward(self, levels: Tensor) -> Tensor:
        """Latent vectors."""
        maps = functional.relu(self.layers(levels[:, None]))
        return self.gather(maps.flatten(1, 2).transpose(1, 2))


class Decoder(nn.Module):
    """From latent vectors (batch, step, latent) to what is expected of every cell's level."""

    def __init__(self, architecture: Architecture, profile: Tensor) -> None:
        super().__init__()
        self.size = architecture.channels, architecture.rows
        self.spread = nn.Linear(architecture.latent, architecture.channels * architecture.rows)
        self.blocks = nn.ModuleList(
            Residual(architecture.channels, architecture.residual) for _ in range(architecture.blocks)
        )
        self.times = [times for *_, times in architecture.stages]
        self.stages = nn.ModuleList(
            nn.Conv2d(given, out, (3, 3 if times == 2 else 1), padding=(1, 1 if times == 2 else 0))
            for given, out, times in architecture.stages
        )
        self.profile = nn.Parameter(profile)

    def forward(self, vectors: Tensor) -> tuple[Tensor, Tensor]:
        """Expected level [nat] and the logarithm of its variance [nat^2], each (batch, padded bins, columns).

        Of the gradient of the variance, a tenth reaches the maps that both read: these serve the levels first.
        """
        maps = self.spread(vectors).transpose(1, 2).unflatten(1, self.size)
        for block in self.blocks:
            maps = block(maps)
        *before, last = self.stages
        for stage, times in zip(before, self.times, strict=False):
            wider = functional.interpolate(functional.relu(maps), scale_factor=(2.0, float(times)), mode="nearest")
            maps = stage(wider)
        maps, times, half = functional.relu(maps), self.times[-1], len(last.weight) // 2
        found = []
        for some, given in (
            (slice(None, half), maps),
            (slice(half, None), OF_VARIANCE * maps + (1 - OF_VARIANCE) * maps.detach()),
        ):
            out = functional.conv2d(given, last.weight[some], last.bias[some], padding=last.padding)
            batch, _, rows, columns = out.shape
            out = out.reshape(batch, 2, times, rows, columns).permute(0, 3, 1, 4, 2)
            found.append(out.reshape(batch, 2 * rows, times * columns))
        return found[0] * NATS_PER_UNIT + self.profile[0][:, None], found[1] + self.profile[1][:, None]


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
        """Expected level [nat], the logarithm of its variance, and the commitment loss."""
        vectors, commitment = self.encoder(levels), levels.new_zeros(1)
        if quantized:
            vectors, _, commitment = self.quantizer(vectors)
        return (*self.decoder(vectors), commitment.sum())


class Prior(nn.Module):
    """Logits of each code given all earlier steps, by a recurrent state, and the codes before it in its step."""

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
        """Logits (batch, step, head, code) of codes (batch, step, head)."""
        batch, _, heads = codes.shape
        head = torch.arange(heads)
        embedded = self.embedding[head, codes].sum(dim=2)
        given = torch.cat([self.start.expand(batch, 1, -1), embedded[:, :-1]], dim=1)
        state, _ = self.gru(functional.dropout(given, dropout))
        units = (functional.dropout(state, dropout) @ self.mixing.T).unflatten(
            2, self.mixing_bias.shape
        ) + self.mixing_bias
        units = units + (self.among * self.later)[head, codes].sum(dim=2)
        return torch.einsum("bthm,hcm->bthc", functional.relu(units), self.readout) + self.readout_bias

    def arrays(self) -> dict[str, Tensor]:
        """What the sampler reads; codes act on later heads only."""
        return {**{name: each for name, each in self.named_parameters()}, "among": self.among * self.later}
