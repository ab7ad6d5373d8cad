"""Classifies a recording over time: sliding windows, on the axes of the maps on which the classifier was trained."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from t2d_rt.core.checks import number
from t2d_rt.core.errors import InputError, warn
from t2d_rt.dataset.products import averaging
from t2d_rt.learn.maps import check_varied, relative_levels
from t2d_rt.learn.saved_models import Card, Ensemble, SavedModel
from t2d_rt.learn.scores import Event
from t2d_rt.motion.descriptions.slots import ACTIONS_OF, RESTS_OF
from t2d_rt.recording.recording import Recording

STEPS, MOST_STEPS = 10, 200
"""Number of windows that begin within the duration of one, by default and at most."""
LEAST_COVERED = 0.5
"""Least fraction of a window that a recording must cover; the rest is filled with the recording's noise floor."""
FLOOR = 0.1
"""Quantile over a recording's columns that counts as its noise floor at each speed: somebody moves in most columns, but not at all
speeds."""
MOST_INSTANTS = 20
"""Greatest number of instants of a course within the duration of a window; the time of the search grows with its square."""
LEAST = 0.8
"""Default of the least duration of an activity, as a fraction of a window."""
APART = 1e-3
"""Least distance between the starts of windows, as a fraction of a step: a recording as long as a window, except for rounding,
gives one window."""
OVER_NOISE, BEYOND = 20.0, 0.01
"""Factor above the median cell from which a cell is certainly an echo, as only one noise cell in a million exceeds it; and fraction
of all power that such cells at speeds outside of the training's may have before there is a warning."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """Classes over the time of a recording."""

    classes: tuple[str, ...]
    starts_s: np.ndarray
    """Start of each window [s], (W,)."""
    duration_s: float
    """Duration of a window [s]."""
    probabilities: np.ndarray
    """Probability of each class in each window, (W, K)."""
    mti: Literal["mean", "none"] = "mean"
    """How static echoes were removed, as for the training."""
    least_s: float = 0.0
    """Least duration of an activity [s]."""

    @property
    def middles_s(self) -> np.ndarray:
        """Middle of each window [s], (W,)."""
        return self.starts_s + 0.5 * self.duration_s

    def at(self, times_s: np.ndarray) -> np.ndarray:
        """Index of the class at each of the times (T,) by the likeliest course, (T,)."""
        instants_s, labels = self.course()
        return np.asarray(labels[nearest(instants_s, np.asarray(times_s, dtype=float))])

    def course(self) -> tuple[np.ndarray, np.ndarray]:
        """Instants from the beginning of the first window to the end of the last [s], (T,), and the index of the class at each.

        The course has the greatest product of probabilities among those in which every activity lasts at least `least_s`; each
        activity is judged by the windows that show little else (`likeliest_course`). With a `least_s` of 0 an instant has the
        likeliest class of the window with the nearest middle.
        """
        wrong = np.flatnonzero(~np.isfinite(self.probabilities).all(axis=1))
        if len(wrong):
            raise InputError(
                f"probabilities must be finite, got {self.probabilities[wrong[0]].tolist()} in window {wrong[0]}; look at the "
                "recording, or at the model's weights"
            )
        first, last = self.starts_s[0], self.starts_s[-1] + self.duration_s
        # Instants have the spacing of the windows, or a finer one where windows are far apart, so that none is skipped.
        steps_s = np.diff(self.starts_s) if len(self.starts_s) > 1 else np.array([self.duration_s])
        step_s = min(self.duration_s, float(np.median(steps_s)))
        if self.least_s > 0:
            step_s = max(step_s, self.duration_s / MOST_INSTANTS)
        count = max(1, round((last - first) / step_s))
        edges_s = np.linspace(first, last, count + 1)
        instants_s = 0.5 * (edges_s[1:] + edges_s[:-1])
        if self.least_s == 0.0:
            return instants_s, self.probabilities[nearest(self.middles_s, instants_s)].argmax(axis=1)
        least = math.ceil(self.least_s * count / (last - first) - APART)
        return instants_s, likeliest_course(self.probabilities, self.middles_s, self.duration_s, edges_s, least)

    def pieces(self) -> list[Event]:
        """The activities of the course, in order."""
        instants_s, labels = self.course()
        changes = np.flatnonzero(np.diff(labels)) + 1
        edges_s = [
            self.starts_s[0],
            *(0.5 * (instants_s[changes] + instants_s[changes - 1])),
            self.starts_s[-1] + self.duration_s,
        ]
        return [
            Event(float(begin), float(end), int(labels[place]))
            for begin, end, place in zip(edges_s[:-1], edges_s[1:], [0, *changes], strict=True)
        ]


def predict(
    model: SavedModel | Ensemble, recording: Recording, *, step_s: float | None = None, least_s: float | None = None
) -> Prediction:
    """Classifies a recording in sliding windows, each as long as the maps of the training.

    step_s: time from one window to the next [s], at least a two-hundredth of a window; a tenth by default.
    least_s: least duration of an activity [s]; 0.8 of a window by default, and with 0 each window is classified by itself.

    Raises InputError where the recording is shorter than half a window or does not cover the speeds of the training; warns of
    anything for which the model was not trained: another carrier, Doppler resolution or contrast, power at other speeds, or a
    recording shorter than a window.
    """
    duration_s = model.card.duration_s
    step_s = duration_s / STEPS if step_s is None else number("step_s", step_s, duration_s / MOST_STEPS, 1e4, unit="s")
    least_s = LEAST * duration_s if least_s is None else number("least_s", least_s, 0.0, 1e4, unit="s")
    ensemble = model if isinstance(model, Ensemble) else Ensemble((model,))
    starts_s, maps = windows_of([member.card for member in ensemble.members], recording, step_s)
    length_s = float(starts_s[-1] - starts_s[0]) + duration_s
    if least_s > length_s * (1 + APART):
        raise InputError(
            f"least_s is {least_s:.3g} s, but the windows of the recording cover {length_s:.3g} s; give a shorter one, or record "
            "longer"
        )
    return Prediction(
        classes=model.card.classes,
        starts_s=starts_s,
        duration_s=model.card.duration_s,
        probabilities=ensemble.mean_of(maps),
        mti=_mti(model.card),
        least_s=least_s,
    )


def events_of(recording: Recording, classes: Sequence[str]) -> list[Event]:
    """What the persons of a simulated recording do, as events of these classes, by person and time.

    An action belongs to the class of its own name, or else to the class to which the descriptions' grammar assigns it: sitting
    down, resting on the seat and standing up belong to sitting. Actions of no class, such as standing, are no events. Consecutive
    actions of one class are one event.
    """
    numbers: dict[str, int] = {
        action: classes.index(name)
        for name, actions in ACTIONS_OF.items()
        if name in classes
        for action in (*actions, *RESTS_OF.get(name, ()))
    }
    numbers |= {name: number for number, name in enumerate(classes)}
    events: list[Event] = []
    before = None
    for person, activity, begin_s, end_s in recording.activities:
        label = numbers.get(activity)
        if label is not None and (person, begin_s, label) == before:
            events[-1] = events[-1]._replace(end_s=end_s)
        elif label is not None:
            events.append(Event(begin_s, end_s, label))
        before = person, end_s, label
    return events


def labels_of_windows(events: Sequence[Event], starts_s: np.ndarray, duration_s: float, classes: int) -> np.ndarray:
    """Index of the class that lasts longest in each window, (W,); -1 for a window without any."""
    shared = np.zeros((len(starts_s), classes))
    for begin_s, end_s, label in events:
        shared[:, label] += np.maximum(np.minimum(starts_s + duration_s, end_s) - np.maximum(starts_s, begin_s), 0.0)
    return np.where(shared.any(axis=1), shared.argmax(axis=1), -1)


def windows_of(cards: Sequence[Card], recording: Recording, step_s: float) -> tuple[np.ndarray, list[np.ndarray]]:
    """Starts of the windows [s], and for each card its maps (W, speed, time), with static echoes removed as for the training.

    Where the mean is removed it is that of each window, as it was that of each record in training: in a long recording, a person
    who rests for part of it would count as a static echo in all of it. Cells of the maps are means over the cells of the recording
    that they cover. A recording shorter than a window makes one window, which is filled up with its noise floor.
    """
    card = cards[0]
    all_columns = _Columns.of(recording.processed(mti=_mti(card)))
    _check_speeds(all_columns, card)
    last = _last_start_s(all_columns, card)
    starts = np.append(np.arange(0.0, last - APART * step_s, step_s), last)
    # Networks with the same cells share their maps.
    kinds = {
        (member_card.size, member_card.velocity_mps, member_card.dynamic_range_db): member_card for member_card in cards
    }
    maps: dict[object, list[np.ndarray]] = {kind: [] for kind in kinds}
    for start in starts:
        if _mti(card) == "none" or all_columns.length_s < card.duration_s * 0.999:
            columns, begin_s = all_columns, all_columns.times[0] + start
        else:
            columns = _Columns.of(_piece(recording, start, card.duration_s, all_columns.length_s))
            begin_s = columns.times[0]
        columns = columns.until(begin_s + card.duration_s)
        for kind, kind_card in kinds.items():
            time_edges = np.linspace(begin_s, begin_s + kind_card.duration_s, kind_card.size[1] + 1)
            speed_edges = _edges(kind_card.axis_mps)
            power = averaging(columns.speeds, speed_edges) @ columns.power @ averaging(columns.times, time_edges).T
            maps[kind].append(relative_levels(power, kind_card.size, kind_card.dynamic_range_db))
            check_varied(maps[kind][-1], f"the window of the recording from {start + all_columns.times[0]:.3g} s")
    stacked = {kind: np.stack(windows) for kind, windows in maps.items()}
    sentences = [
        sentence
        for member_card in cards
        for sentence in member_card.unfamiliar(
            "the recording", carrier_hz=recording.radar.carrier_hz, cell_mps=float(np.diff(all_columns.speeds[:2])[0]),
            levels=stacked[member_card.size, member_card.velocity_mps, member_card.dynamic_range_db],
        )
    ]  # fmt: skip
    for sentence in dict.fromkeys(sentences):
        warn(sentence)
    return starts + all_columns.times[0], [
        stacked[member_card.size, member_card.velocity_mps, member_card.dynamic_range_db] for member_card in cards
    ]


def _check_speeds(columns: _Columns, card: Card) -> None:
    """Refuses a recording that does not cover the speeds of the training, and warns of power at other speeds."""
    speed_edges = _edges(card.axis_mps)
    bin_mps = columns.speeds[1] - columns.speeds[0]
    if speed_edges[0] < columns.speeds[0] - bin_mps or speed_edges[-1] > columns.speeds[-1] + bin_mps:
        raise InputError(
            f"the recording shows {columns.speeds[0]:.3g} to {columns.speeds[-1]:.3g} m/s, the model was trained on "
            f"{speed_edges[0]:.3g} to {speed_edges[-1]:.3g} m/s; record with a higher chirp rate, or train on a recipe "
            "whose speed_mps is lower"
        )
    echoes = np.where(columns.power > OVER_NOISE * np.median(columns.power), columns.power, 0.0).sum(axis=1)
    inside = (columns.speeds[1:] > speed_edges[0]) & (columns.speeds[:-1] < speed_edges[-1])
    beyond = float(echoes[~inside].sum() / max(columns.power.sum(), 1e-300))
    if beyond > BEYOND:
        warn(
            f"{100 * beyond:.0f} % of the recording's power is at speeds beyond {speed_edges[0]:.3g} to {speed_edges[-1]:.3g} m/s, "
            "which the model does not see; train on a recipe whose speed_mps is higher"
        )


def _last_start_s(columns: _Columns, card: Card) -> float:
    """Start of the last window relative to the first [s]; warns of a recording shorter than a window, and refuses one shorter than
    half of that."""
    lengths = (
        f"the recording has {columns.length_s:.3g} s of spectrogram, a window of the model {card.duration_s:.3g} s"
    )
    if columns.length_s < LEAST_COVERED * card.duration_s:
        raise InputError(
            f"{lengths}; record longer, {LEAST_COVERED * card.duration_s:.3g} s or more, or train on a shorter duration_s"
        )
    if columns.length_s < card.duration_s * 0.999:
        warn(
            f"{lengths}; the one window goes on at the recording's floor, so do not trust its class as one of a whole window"
        )
    return max(columns.length_s - card.duration_s, 0.0)


@dataclass(frozen=True, slots=True)
class _Columns:
    """A spectrogram with the edges of its cells."""

    power: np.ndarray
    """Power (speed, time)."""
    speeds: np.ndarray
    """Edges of the speed cells [m/s], (speed + 1,)."""
    times: np.ndarray
    """Edges of the time cells [s], (time + 1,)."""

    @classmethod
    def of(cls, recording: Recording) -> _Columns:
        """A recording's spectrogram as powers, with the edges of its cells."""
        image = recording.spectrogram
        if min(image.shape) < 2:
            raise InputError(
                f"a spectrogram of {image.shape[0]} speeds and {image.shape[1]} instant(s) tells nothing over time; record longer"
            )
        power = 10.0 ** (image.values.astype(np.float64) / 10.0)
        return cls(power, _edges(image.velocity_mps.values), _edges(image.time_s.values))

    @property
    def length_s(self) -> float:
        return float(self.times[-1] - self.times[0])

    def until(self, end_s: float) -> _Columns:
        """These columns, followed by one at the noise floor up to `end_s` if they end at least a column earlier."""
        if end_s - self.times[-1] < self.times[-1] - self.times[-2]:
            return self
        floor = np.quantile(self.power, FLOOR, axis=1, keepdims=True)
        return _Columns(np.hstack([self.power, floor]), self.speeds, np.append(self.times, end_s))


def _piece(recording: Recording, start_s: float, duration_s: float, length_s: float) -> Recording:
    """The part of a recording from `start_s` on whose spectrogram covers `duration_s`, in whole bursts.

    length_s: duration that the spectrogram of the whole recording covers.
    """
    begins = recording.radar.chirp_starts_s(len(recording.cube))
    begins = begins - begins[0]
    # What the windows of the transform lose at the ends, or pauses between bursts add, is the same for a part as for the whole.
    beyond_s = float(begins[-1]) + recording.radar.loop_interval_s - length_s
    half_s = 0.5 * recording.radar.loop_interval_s
    burst = recording.radar.loops_per_frame or 1
    first = int(np.searchsorted(begins, start_s - half_s)) // burst * burst
    stop = int(np.searchsorted(begins, begins[first] + duration_s + beyond_s - half_s))
    stop = min(-(-(stop - first) // burst) * burst + first, len(begins))
    return Recording(
        np.asarray(recording.cube[first:stop]),
        recording.radar,
        settings=recording.settings,
        processing={**recording.processing, "mti": "mean"},
    )


def _mti(card: Card) -> Literal["mean", "none"]:
    """How static echoes were removed for the training; the mean, if the card does not say."""
    return "none" if card.about.get("mti") == "none" else "mean"


def _edges(centres: np.ndarray) -> np.ndarray:
    """Edges of cells from their centres, (N + 1,)."""
    middles = 0.5 * (centres[1:] + centres[:-1])
    first, last = centres[0] - (middles[0] - centres[0]), centres[-1] + (centres[-1] - middles[-1])
    return np.concatenate([[first], middles, [last]])


LEAST_PROBABILITY = 1e-2
"""Least probability that is used for a class, or the mean probability of all classes if that is less, since windows over a change
may be certain of a wrong class."""
SHARPNESS = 16
"""A window that would have to move by a fraction x of its duration to show a single activity has the weight (1 - x) to this
power."""
LONGEST = 4
"""Greatest duration of an activity in the search, in windows, or twice the least duration if that is more; longer activities are
made of several of the same class."""
LEAST_WEIGHT = 1e-12
"""Added to the weight of the nearest window, so that a weight is positive where windows are far apart."""


def likeliest_course(
    probabilities: np.ndarray, middles_s: np.ndarray, duration_s: float, edges_s: np.ndarray, least: int
) -> np.ndarray:
    """Index of the class at each instant, (T,), of the likeliest course: among all courses of activities of at least `least`
    instants, the one with the greatest product of probabilities over all instants. Where there are fewer instants, a single
    activity lasts for all of them.

    The probability at an instant is a weighted geometric mean over the windows around its activity. A window within the activity
    has full weight. One that would have to move by a fraction x of its duration to lie within it, or to be centred at a shorter
    activity, has the weight (1 - x)^16. So windows over a change have little effect where others show a single activity; one stray
    window among many overlapping ones makes no activity, unless it is the first or the last; and each instant counts once, whatever
    the course. Neighbouring activities may be of one class, such as a slow and a fast walk: each is judged by itself.

    probabilities: of each class in each window, (W, K).
    middles_s: middles of the windows [s], (W,), ascending.
    duration_s: duration of a window [s].
    edges_s: edges between instants of equal duration [s], (T + 1,).
    """
    count, classes = len(edges_s) - 1, probabilities.shape[1]
    scores = np.log(np.maximum(probabilities, min(LEAST_PROBABILITY, 1.0 / classes)))
    least = min(max(1, least), count)
    per_window = duration_s * count / float(edges_s[-1] - edges_s[0])
    longest = max(2 * least, math.ceil(LONGEST * per_window))
    best = np.full(count + 1, -np.inf)  # score of the best course that ends at each edge
    best[0] = 0.0
    last = np.zeros((count + 1, 2), dtype=int)  # last activity of that course: where it begins, and its class
    for end in range(least, count + 1):
        starts = np.arange(max(0, end - longest), end - least + 1)
        means = _means(scores, middles_s, duration_s, edges_s[starts], edges_s[end])
        totals = best[starts, None] + (end - starts)[:, None] * means
        row, label = np.unravel_index(int(np.argmax(totals)), totals.shape)
        best[end] = totals[row, label]
        last[end] = starts[row], label
    labels = np.zeros(count, dtype=int)
    end = count
    while end > 0:
        start, label = last[end]
        labels[start:end] = label
        end = start
    return labels


def _means(
    scores: np.ndarray, middles_s: np.ndarray, duration_s: float, starts_s: np.ndarray, end_s: float
) -> np.ndarray:
    """Weighted mean of the windows' scores (W, K) over activities from each start to the end [s], (S, K)."""
    first, after = np.searchsorted(middles_s, [starts_s[0] - duration_s, end_s + duration_s])
    nearby = slice(max(first - 1, 0), after + 1)
    middles_s, scores = middles_s[nearby], scores[nearby]
    centres_s, spare_s = 0.5 * (starts_s + end_s), np.maximum(0.5 * (end_s - starts_s - duration_s), 0.0)
    shift = np.maximum(np.abs(middles_s - centres_s[:, None]) - spare_s[:, None], 0.0) / duration_s
    weights = np.maximum(1.0 - shift, 0.0) ** SHARPNESS
    weights[np.arange(len(weights)), shift.argmin(axis=1)] += (
        LEAST_WEIGHT  # without such a window the nearest one counts
    )
    return np.asarray(weights @ scores / weights.sum(axis=1)[:, None])


def nearest(places: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Index of the nearest of ascending positions (N,) for each wanted one, in the shape of these; the earlier one if two are
    equally near."""
    if len(places) == 1:
        return np.zeros(np.shape(wanted), dtype=int)
    after = np.clip(np.searchsorted(places, wanted), 1, len(places) - 1)
    return np.asarray(after - (wanted - places[after - 1] <= places[after] - wanted))
