"""Sizes of the networks: what the trainer builds and the sampler reads."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from t2d_rt.core.checks import integer, options
from t2d_rt.core.errors import InputError

KEPT_ROWS = 6
"""Rows of the coarsest maps, at least: fewer would not tell an approaching from a receding interferer."""
HALO = 3
"""Steps on either side that the decoder's convolutions reach over, for 2 residual blocks and any stages."""
LARGEST = 4096
"""Of any size: what exceeds it was damaged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Architecture:
    """Code books of `codes` entries for the `heads` parts of a latent vector, one vector for each step of `columns` columns."""

    bins: int
    """Doppler bins of the spectrograms."""
    time_halvings: int = 3
    """A step is 2^time_halvings columns."""
    heads: int = 4
    """Codes in a step, each of its own code book."""
    codes: int = 32
    """Entries of each code book."""
    code_size: int = 16
    """Numbers in an entry."""
    channels: int = 64
    """Of the coarsest maps."""
    residual: int = 32
    """Of the middle of a residual block (van den Oord et al. 2017)."""
    blocks: int = field(default=2)
    """Residual blocks."""
    hidden: int = 192
    """State of the prior over time."""
    mixed: int = 64
    """Units of the prior within a step."""

    @classmethod
    def of(cls, values: Any) -> Architecture:
        """Checked sizes, from a file's mapping."""
        names = [each.name for each in fields(cls)]
        found = cls(
            **{key: integer(key, value, 1, LARGEST) for key, value in options("architecture", values, names).items()}
        )
        if found.time_halvings > found.doppler_halvings:
            raise InputError(
                f"{found.bins} Doppler bins are halved {found.doppler_halvings} times and columns {found.time_halvings} times; "
                "take fewer time_halvings"
            )
        if found.blocks > 2:
            raise InputError(f"blocks must be 1 or 2, got {found.blocks}")
        return found

    def described(self) -> dict[str, int]:
        """Sizes as a mapping."""
        return asdict(self)

    @property
    def columns(self) -> int:
        """Columns of the spectrogram in a step."""
        return int(2**self.time_halvings)

    @property
    def doppler_halvings(self) -> int:
        """How often Doppler bins are halved."""
        return max(1, int(math.log2(max(2, self.bins / KEPT_ROWS))))

    @property
    def rows(self) -> int:
        """Doppler rows of the coarsest maps; bins are padded to rows times 2^doppler_halvings."""
        return int(-(-self.bins // 2**self.doppler_halvings))

    @property
    def padded_bins(self) -> int:
        """Bins with those that are padded."""
        return int(self.rows * 2**self.doppler_halvings)

    @property
    def latent(self) -> int:
        """Numbers of a latent vector."""
        return self.heads * self.code_size

    @property
    def stages(self) -> list[tuple[int, int, int]]:
        """Doublings from the coarsest maps to the spectrogram: channels in, channels out, and the factor in time (1 or 2).

        The last one leads to 2 x 2 (or 2 x 1) cells of two channels each, mean and looks."""
        count = self.doppler_halvings
        times = [1] * (count - self.time_halvings) + [2] * self.time_halvings
        sizes = [max(16, round(self.channels / 16 / (1 + 0.5 * stage)) * 16) for stage in range(count)]
        outs = [*sizes[1:], 2 * 2 * times[-1]]
        return list(zip(sizes, outs, times, strict=True))
