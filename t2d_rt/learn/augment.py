"""Augmentation of spectrograms during training: background, masks, shifts, Doppler jitter, gain, and neighbouring activities.

Maps are changed in the ways in which another record of the same activity would differ: in its beginning, view, level and
surroundings.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import ConfigDict, Field

from t2d_rt.dataset.products import resized
from t2d_rt.noise.background import load_background
from t2d_rt.noise.background.model import between
from t2d_rt.noise.masks import OcclusionMask, covered
from t2d_rt.types.fields import Count, Fields, Number

BANK = 16
"""Number of backgrounds that are sampled once; each sample gets one of them at random, with a random shift in time."""
VARIANTS = 6
"""Number of variants of each sample in augmentation for sliding windows."""


class Augment(Fields):
    """Kinds and amounts of augmentation. Each sample has random draws of its own in each epoch."""

    noun: ClassVar[str] = "augmentation"
    model_config = ConfigDict(use_attribute_docstrings=True)

    background_db: Annotated[Number, Field(ge=-100, le=0)] | None = None
    """Greatest level of the noise floor of a learned background, relative to the map's greatest cell [dB]; it is drawn from 20 dB
    below that up to it. None adds no background."""
    masks: OcclusionMask | None = None
    """Time windows in which the map shows the background, or nothing where there is none."""
    shift: Annotated[Number, Field(ge=0, le=0.5)] = 0.0
    """Greatest shift in time, as a fraction of the duration; the gap is filled by a mirror image."""
    doppler: Annotated[Number, Field(ge=0, le=0.5)] = 0.0
    """Greatest relative change of all speeds, as a fraction."""
    follow: Annotated[Number, Field(ge=0, le=0.5)] = 0.0
    """Greatest fraction of the duration, at the beginning or the end, that another training sample replaces, as in a window over a
    change of activities; the class is that of the window's middle."""
    gain_db: Annotated[Number, Field(ge=0, le=40)] = 0.0
    """Greatest decrease of the map's levels [dB], as by a stronger echo elsewhere."""
    mirror: Annotated[Number, Field(ge=0, le=1)] = 0.0
    """Probability with which approaching and receding are exchanged, as if the person had turned round."""
    variants: Annotated[Count, Field(ge=1, le=10_000)] | None = None
    """Number of different variants of each sample; one is used in an epoch, in turn with the unchanged sample. None draws new ones
    in each epoch. A small number suits models whose features take long to compute."""

    @classmethod
    def usual(cls) -> Augment:
        """All augmentations except `follow`, of moderate size."""
        return cls(background_db=-20.0, masks=OcclusionMask(windows=0.5), shift=0.1, doppler=0.1, gain_db=6.0)

    @classmethod
    def sliding(cls) -> Augment:
        """Augmentation for windows that slide over a recording of several activities."""
        return cls(follow=0.4, doppler=0.1, gain_db=6.0, mirror=0.5, variants=VARIANTS)

    @property
    def some(self) -> bool:
        """Whether anything is changed."""
        return self.model_copy(update={"variants": None}) != Augment()

    def variant(self, epoch: int) -> int | None:
        """Index of the variant for an epoch; None where samples are unchanged."""
        if self.variants is None:
            return epoch
        number = epoch % (self.variants + 1)
        return number - 1 if number else None


FOLLOW_DB = 10.0
"""Greatest difference of level between activities that follow one another [dB], as for ranges that differ by a factor of 1.8."""


class Augmenter:
    """Augments maps of one size, with random draws that depend on a seed and on the sample."""

    def __init__(
        self, augment: Augment, size: tuple[int, int], duration_s: float, floor_db: float, *, seed: int
    ) -> None:
        self.augment, self._duration_s, self._floor_db, self._seed = augment, duration_s, floor_db, seed
        self._bank = None
        if augment.background_db is not None:
            model = load_background()
            backgrounds = [model.sample(duration_s, seed=seed * BANK + number).power for number in range(BANK)]
            # The background model's bins are stretched to those of the map: it stands for clutter and noise in general, not for
            # another radar.
            self._bank = np.stack([resized(power.astype(np.float64), size) for power in backgrounds])

    def __call__(self, levels: np.ndarray, rng: np.random.Generator, others: np.ndarray) -> np.ndarray:
        """Augmented levels of a map (speed, time) [dB, 0 at the greatest cell]; `others` (N, speed, time) are samples that may
        precede or follow it."""
        augment = self.augment
        if augment.follow > 0:
            levels = _followed(
                levels, others[rng.integers(len(others))], rng.uniform(-augment.follow, augment.follow), rng
            )
        if augment.shift > 0:
            levels = _shifted(levels, round(rng.uniform(-augment.shift, augment.shift) * levels.shape[1]))
        if augment.doppler > 0:
            levels = _stretched(levels, 1.0 + rng.uniform(-augment.doppler, augment.doppler))
        if augment.mirror > 0 and rng.random() < augment.mirror:
            levels = levels[::-1]
        if augment.gain_db > 0:
            levels = levels - np.float32(rng.uniform(0, augment.gain_db))
        background = None
        if self._bank is not None and augment.background_db is not None:
            power = np.roll(self._bank[rng.integers(BANK)], rng.integers(levels.shape[1]), axis=1)
            background = power * 10.0 ** (rng.uniform(augment.background_db - 20.0, augment.background_db) / 10.0)
            levels = 10.0 * np.log10(10.0 ** (levels / 10.0) + background)
        if augment.masks is not None:
            levels = self._masked(levels, background, augment.masks, rng)
        return np.clip(levels, self._floor_db, 0.0).astype(np.float32)

    def of_epoch(self, epoch: int, levels: np.ndarray, places: np.ndarray) -> np.ndarray:
        """The samples at these positions of levels (N, speed, time) as they are used in an epoch, with random draws for each."""
        variant = self.augment.variant(epoch)
        if variant is None:
            return levels[places]
        draws = [np.random.default_rng([self._seed, variant, 1, int(place)]) for place in places]
        return np.stack([self(levels[place], rng, levels) for place, rng in zip(places, draws, strict=True)])

    def _masked(
        self, levels: np.ndarray, background: np.ndarray | None, masks: OcclusionMask, rng: np.random.Generator
    ) -> np.ndarray:
        """Levels in which columns in random windows show the background, or the least level if there is none."""
        count = levels.shape[1]
        middles = (np.arange(count) + 0.5) * self._duration_s / count
        windows = masks.draw(self._duration_s, seed=int(rng.integers(2**31)))
        filled = np.full_like(levels, self._floor_db) if background is None else 10.0 * np.log10(background + 1e-30)
        return np.where(covered(middles, windows), filled, levels)


def _shifted(levels: np.ndarray, columns: int) -> np.ndarray:
    """Levels moved by so many columns; the gap at one end is filled by a mirror image."""
    if columns == 0:
        return levels
    padded = np.pad(levels, ((0, 0), (max(columns, 0), max(-columns, 0))), mode="symmetric")
    start = 0 if columns > 0 else -columns
    return padded[:, start : start + levels.shape[1]]


def _followed(levels: np.ndarray, neighbour: np.ndarray, part: float, rng: np.random.Generator) -> np.ndarray:
    """The map in a window that is moved by a fraction of its length, so that a neighbouring activity is in view."""
    shift = round(part * levels.shape[1])
    if shift == 0:
        return levels
    neighbour = neighbour + np.float32(rng.uniform(-FOLLOW_DB, FOLLOW_DB))
    parts = [neighbour[:, -shift:], levels[:, :-shift]] if shift > 0 else [levels[:, -shift:], neighbour[:, :-shift]]
    joined = np.concatenate(parts, axis=1)
    return np.asarray(joined - joined.max())


def _stretched(levels: np.ndarray, factor: float) -> np.ndarray:
    """Levels with all speeds multiplied by a factor; beyond the axis its last rows are repeated."""
    count = len(levels)
    source_rows = np.clip((np.arange(count) - 0.5 * (count - 1)) / factor + 0.5 * (count - 1), 0, count - 1)
    return between(levels, source_rows, 0)
