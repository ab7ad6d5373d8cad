"""Echoes over several bounces within and between targets (docs/physics.md, eq. 31)."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from typing_extensions import override

from t2d_rt.core.backend import Backend
from t2d_rt.core.constants import SPEED_OF_LIGHT
from t2d_rt.core.memory import MemoryLimit, blocks
from t2d_rt.scattering.antennas import seen_by
from t2d_rt.scattering.ray_fronts import Instant, RayTracer
from t2d_rt.scattering.reflectors import Lattice, Reflector, Reflectors, carried_along, lattice, lattice_size
from t2d_rt.scattering.streams import joined, most_echoes
from t2d_rt.scattering.tube_groups import Cells, Frames, Groups, TubeSample
from t2d_rt.scattering.tubes import Tubes, reflecting, traced_tubes
from t2d_rt.types import EchoArrays, Radar
from t2d_rt.types.scatterer import EchoLabels, FrameBlock, Poses, Scatterer, Visibility

TEST_WAVELENGTHS, TEST_RATE_HZ = 4.0, 10.0
"""Spacing of the points [wavelengths] and rate [Hz] at which facets are tested for whether their reflected rays ever meet a target;
the facets beside those that do are taken, too."""
KEPT_BYTES = 500e6
"""Memory [bytes] for the tubes of the sample times that were used last; those of other times are traced again."""
TUBE_BYTES = 4_000
"""Memory [bytes] that tracing takes for each triangle of the lattice, with its four tubes and the finer ones."""
SWEEP_CYCLES = 0.4
"""Greatest change over the sweep of the phase between two sides of a cell [cycles]."""
Scene = Callable[[np.ndarray, np.ndarray], RayTracer]
"""Function that gives the ray tracer of a mesh with vertices (V, 3) [m] and triangles (F, 3)."""
Unblocked = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Function that gives the fraction (N,) of the field that the static scene does not block, over paths out to points (N, 3) [m] and
back from points (N, 3) [m], at times (N,) [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TubeDetail:
    """How finely several bounces are modelled."""

    bounces: int
    """Greatest number of bounces, 2 or 3."""
    spacing: float = 2.0
    """Longest edge of ray tubes on the first surface [wavelengths], before they are made finer where they have to be."""
    cell_m: float = 0.02
    """Greatest size of the cells of the surfaces [m]; tubes between the same cells return one echo. At twice a walk's surface rate
    interpolation errs by -15 dB with 3 cm, by -23 dB with 2 cm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Radar and surroundings in which tubes are traced."""

    radar: Radar
    scene: Scene
    backend: Backend
    unblocked: Unblocked | None = None
    """What the static scene does not block; None in free space."""
    memory: MemoryLimit | None = None
    """Limit on the memory of a run; None: it is not checked."""

    def lattice(self, reflectors: Reflectors, faces: np.ndarray, spacing_m: float) -> Lattice:
        """`reflectors.lattice`; raises InputError if the tubes that start on it would take too much memory."""
        if self.memory is not None:
            count = lattice_size(reflectors, faces, spacing_m)
            remedy = "leave large surfaces out of the targets (a wall belongs to a scene), or take bounces=1"
            self.memory.check(TUBE_BYTES * count, f"tracing rays from {count:,} places".replace(",", " "), remedy)
        return lattice(reflectors, faces, spacing_m)


def bounce_echoes(
    reflectors: Sequence[Reflector],
    setting: Setting,
    *,
    times_s: np.ndarray,
    samples_s: np.ndarray,
    detail: TubeDetail,
) -> Scatterer:
    """Echoes of 2 to `detail.bounces` bounces at surface frames `times_s` (T,) [s]. Ray tubes are traced at `samples_s` (S,) [s];
    in between, their points move with the surfaces, and each set of tubes fades into the next."""
    model = _Model.of(Reflectors(reflectors), setting, samples_s, detail)
    samples = _Samples(model, samples_s)
    groups = samples.groups()
    size = most_echoes(setting.radar)
    parts = [groups.only(slice(first, first + size)) for first in range(0, max(1, len(groups)), size)]
    return joined(
        [
            TubeScatterer(
                times_s=times_s, samples=samples, groups=part, echoes=len(part), vertices=model.reflectors.vertex_count
            )
            for part in parts
        ]
    )


@dataclass(frozen=True, slots=True)
class _Model:
    """What all sample times have in common."""

    reflectors: Reflectors
    setting: Setting
    detail: TubeDetail
    lattice: Lattice
    cells: Cells

    @classmethod
    def of(cls, reflectors: Reflectors, setting: Setting, samples_s: np.ndarray, detail: TubeDetail) -> _Model:
        """A model with a lattice on the facets whose reflected rays ever meet a target, and on those beside them."""
        wavelength = setting.radar.wavelength_m
        size_m = min(detail.cell_m, SWEEP_CYCLES * SPEED_OF_LIGHT / (2 * setting.radar.bandwidth_hz))
        test_lattice = setting.lattice(reflectors, np.arange(len(reflectors.faces)), TEST_WAVELENGTHS * wavelength)
        empty = cls(reflectors, setting, detail, test_lattice, Cells.of(reflectors, size_m))
        count = max(2, math.ceil((samples_s[-1] - samples_s[0]) * TEST_RATE_HZ) + 1)
        tests = samples_s[np.unique(np.linspace(0, len(samples_s) - 1, min(count, len(samples_s))).round().astype(int))]
        reached = np.zeros(len(reflectors.faces), bool)
        for instant in empty.instants(tests):
            reached[reflecting(instant, test_lattice)] = True
        beside = np.flatnonzero(reflectors.neighbours @ reached.astype(float))
        return replace(empty, lattice=setting.lattice(reflectors, beside, detail.spacing * wavelength))

    def instants(self, times_s: np.ndarray) -> Iterator[Instant]:
        """The targets in their poses at times (K,) [s], one after another."""
        radar = self.setting.radar
        for block_s in blocks(times_s, self.reflectors.vertex_count):
            for vertices in self.reflectors.at(block_s):
                yield Instant(
                    reflectors=self.reflectors,
                    posed=self.reflectors.posed(vertices),
                    rays=self.setting.scene(vertices, self.reflectors.faces),
                    transmitter_m=radar.tx_position_m,
                    receiver_m=radar.rx_position_m,
                    wavelength_m=radar.wavelength_m,
                )

    def frames(self, times_s: np.ndarray) -> Frames:
        """The targets at surface frames `times_s` (K,) [s]."""
        return Frames.of(self.reflectors, times_s, self.setting.radar, self.setting.backend)

    def sample(self, time_s: float) -> list[TubeSample]:
        """Tubes at one time [s]: a sample for each number of bounces, from 2 on."""
        (instant,) = self.instants(np.array([time_s]))
        return [
            TubeSample.of(self._unblocked(time_s, instant, traced_tubes(instant, self.lattice, bounces)), self.cells)
            for bounces in range(2, self.detail.bounces + 1)
        ]

    def _unblocked(self, time_s: float, instant: Instant, tubes: Tubes) -> Tubes:
        """Tubes, times the fraction of the field that the static scene does not block; this is found for one tube for each pair of
        cells where tubes start and end."""
        if self.setting.unblocked is None or not len(tubes.factor):
            return tubes
        corner = tubes.nodes[:, 0]
        ends = [0, -1]
        cells = self.cells.numbers(tubes.faces[corner][:, ends], tubes.coordinates[corner][:, ends])
        _, first, inverse = np.unique(cells, axis=0, return_index=True, return_inverse=True)
        faces, coordinates = (column[corner[first]][:, ends] for column in (tubes.faces, tubes.coordinates))
        places = carried_along(instant.posed.corners[faces], coordinates)
        fraction = self.setting.unblocked(places[:, 0], places[:, 1], np.full(len(places), time_s))
        return replace(tubes, factor=tubes.factor * fraction[inverse.ravel()])


class _Samples:
    """Tubes at the sample times, kept as far as memory allows."""

    def __init__(self, model: _Model, samples_s: np.ndarray) -> None:
        self.model, self.times_s = model, samples_s
        self._held: OrderedDict[int, list[TubeSample]] = OrderedDict()

    def at(self, number: int) -> list[TubeSample]:
        """Tubes at the sample time of that number: a sample for each number of bounces, from 2 on."""
        if number not in self._held:
            self._held[number] = self.model.sample(float(self.times_s[number]))
            while (
                len(self._held) > 2
                and sum(sample.tubes.bytes_held for samples in self._held.values() for sample in samples) > KEPT_BYTES
            ):
                self._held.popitem(last=False)
        self._held.move_to_end(number)
        return self._held[number]

    def groups(self) -> Groups:
        """Groups of the tubes of all sample times."""
        samples: list[TubeSample] = []
        powers: list[np.ndarray] = []
        for number, time_s in enumerate(self.times_s):
            posed = self.model.frames(np.array([time_s]))
            for sample in self.at(number):
                powers.append(posed.powers(sample))
                samples.append(sample.of_carriers())
        return Groups.of(samples, powers, self.model.detail.bounces, self.model.reflectors.target)


@dataclass(frozen=True, kw_only=True, eq=False)
class TubeScatterer(Scatterer):
    """Groups of ray tubes, which return one echo each."""

    samples: _Samples
    groups: Groups

    @property
    @override
    def labels(self) -> EchoLabels:
        return EchoLabels.of(self.echoes, bounces=self.groups.bounces)

    @override
    def scatter(self, block: FrameBlock, poses: Poses, seen: Visibility) -> EchoArrays:
        samples, groups, times_s = self.samples, self.groups, block.times_s
        model, radar = samples.model, samples.model.setting.radar
        posed = model.frames(times_s)
        count = len(times_s)
        shape = count, len(groups)
        delay, field, change = np.zeros(shape), np.zeros(shape, np.complex64), np.zeros(shape, np.complex64)
        weights = _faded(times_s, samples.times_s)
        for bounces in range(2, model.detail.bounces + 1):
            of_bounces, first = groups.of_bounces(bounces)
            if not len(of_bounces):
                continue
            straight = np.ones((len(of_bounces), bounces - 1))
            lengths = posed.lengths(of_bounces.faces, of_bounces.coordinates, straight, np.arange(count))
            carriers_m = lengths.numpy().reshape(len(of_bounces), -1)
            delay[:, first : first + len(of_bounces)] = carriers_m.T / SPEED_OF_LIGHT
            for number, (frames, weight) in weights.items():
                sample = samples.at(number)[bounces - 2]
                column = of_bounces.columns(sample.codes)
                for into, sums in zip((field, change), posed.sums(sample, column, carriers_m, frames), strict=True):
                    into[frames[:, None], first + column[column >= 0]] += (sums * weight).T
        # The factor before the sum of eq. 31.
        scale = -1j * radar.link_amplitude * math.sqrt(4 * math.pi) / radar.wavelength_m
        per_hz = scale / radar.mid_frequency_hz
        arrays = EchoArrays(delay, (scale * field).astype(np.complex64), (per_hz * change).astype(np.complex64))
        if not (radar.is_array or radar.directional):
            return arrays
        return seen_by(radar, arrays, *(posed.places(groups, end) for end in (0 * groups.bounces, groups.bounces - 1)))


def _faded(times_s: np.ndarray, samples_s: np.ndarray) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """By the number of a sample: the frames (K,) at which its tubes count, and their weights there (K,), which fade smoothly from
    one sample to the next."""
    if len(samples_s) == 1:
        return {0: (np.arange(len(times_s)), np.ones(len(times_s)))}
    position = np.interp(times_s, samples_s, np.arange(len(samples_s)))
    before = np.minimum(position.astype(int), len(samples_s) - 2)
    u = position - before
    fade = u * u * (3 - 2 * u)
    weights = {}
    for number in np.unique([before, before + 1]):
        weight = np.where(before == number, 1 - fade, 0) + np.where(before + 1 == number, fade, 0)
        frames = np.flatnonzero(weight > 0)
        if len(frames):
            weights[int(number)] = frames, weight[frames]
    return weights
