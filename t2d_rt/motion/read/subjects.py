"""Tell the persons of one file apart by what stands before or after the names of their points.

Trackers write `Anna:LASI`, `Anna_LASI`, `Anna.LASI`, `LASI_2` or `LASI` twice. What is before or after such a sign names a subject
if the labels that share it are all that a person needs; so `left_` of `left_hip` names none, nor does the prefix of a chair.
Points of one subject never complete another.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from t2d_rt.core.checks import numbered, shown
from t2d_rt.core.errors import InputError, printable, warn
from t2d_rt.motion.read.tracks import Tracks

SIGNS = ":_.-|/# "

SIGN = re.compile(rf"[{re.escape(SIGNS)}]+|(?<=[^\W\d])(?=\d+$)|(?<=\d)(?=[^\W\d])")
"""What separates a subject's name from a point's: a sign, the start of a final number (`LASI2`) or the end of one (`P2LASI`)."""

FEWEST_LABELS = 12
"""Fewest labels of a person: hips, knees, ankles, shoulders, elbows and wrists."""

ALIKE = 6
"""Fewest labels that an incomplete subject has in common with others: half of a person's."""

Labels = dict[str, str]
"""A subject's labels as they stand in the file, by the labels without its name."""

Affix = tuple[str, str]
"""Whether a subject's name stands "before" or "after" the point's name, and its text."""


People = Mapping[str, Callable[[], Tracks]]
"""Functions that read the subjects of a file, by name, in its order; the name is "" if a file of one person gives none. A function
raises an InputError if its subject lacks anything."""


def people_of_labels(
    labels: Sequence[str], lacking: Callable[[Sequence[str]], Sequence[str]], read: Callable[[Labels], Tracks]
) -> People:
    """The subjects that labels tell apart.

    lacking: says which labels a person needs beside the given ones. read: reads one subject by its labels.
    """
    by_subject = subjects(labels, lacking)
    if by_subject:
        return {name: partial(read, own_labels) for name, own_labels in by_subject.items()}
    # The prefixes are those of one person or of its parts, or there are none; of equal points the first is taken.
    prefixes = [*dict.fromkeys(printable(label.rpartition(":")[0]) for label in labels)]
    labels_by_point: Labels = {}
    for label in labels:
        labels_by_point.setdefault(label.rpartition(":")[2].strip(), label)
    if len(prefixes) == 1:
        return {prefixes[0]: partial(read, labels_by_point)}
    return {"": partial(_of_parts, read, labels_by_point, prefixes)}


def _of_parts(read: Callable[[Labels], Tracks], labels: Labels, prefixes: list[str]) -> Tracks:
    """Tracks of one person whose parts have prefixes of their own."""
    return _told(read(labels), f"labels with {shown(prefixes)} before the colon taken as one person's")


def _told(tracks: Tracks, clause: str) -> Tracks:
    """Tracks whose report begins with a clause."""
    return replace(tracks, clauses=(clause, *tracks.clauses))


def subject_of(people: People, name: str) -> Tracks:
    """Tracks of one subject by its name; if there are several, the report says which it is."""
    tracks = people[name]()
    return tracks if len(people) == 1 else _told(tracks, f"subject {name} of {', '.join(people)}")


def one_of(people: People, subject: str | None) -> Tracks:
    """Tracks of the subject that is wanted, or of the first that can be read, with a warning that names the others.

    Raises an InputError if the subject is not in the file or none can be read.
    """
    names = list(people)
    if subject is not None:
        alike = [name for name in people if name.lower() == subject.lower()]
        names = [name for name in alike if name == subject] or alike
        if not names or not names[0]:
            choices = (
                f"its subjects are {', '.join(people)}"
                if any(people)
                else "it holds one, without a name; leave subject out"
            )
            raise InputError(f"subject {shown(subject)} is not in the file; {choices}")
    faults: list[str] = []
    for name in names:
        try:
            tracks = subject_of(people, name)
        except InputError as error:
            faults.append(f"{name}: {error}" if name else str(error))
        else:
            break
    else:
        also = f"; the file's subjects are {', '.join(people)}" if len(people) > 1 else ""
        raise InputError(f"{faults[0]}{also}")
    if subject is None and len(people) > 1:
        others = names[names.index(name) + 1 :]
        why = f" ({faults[0].partition(';')[0]})" if faults else ""
        advice = f"; give subject={others[0]!r} (--motion.subject {others[0]}) for another" if others else ""
        warn(f"the file holds {len(people)} subjects, {', '.join(people)}: {name} is taken{why}{advice}")
    return tracks


def subjects(labels: Sequence[str], lacking: Callable[[Sequence[str]], Sequence[str]]) -> dict[str, Labels]:
    """Labels of the subjects by name, in the file's order, also of incomplete ones that are named in the same way; may be empty."""
    groups: dict[Affix, Labels] = {}
    for label in labels:
        for sign in [*SIGN.finditer(label)][:16]:
            head, tail, between = label[: sign.start()], label[sign.end() :], sign.group()
            if head and tail and (between or head[-1].isdigit()):
                groups.setdefault(("before", head + between), {})[tail] = label
            if head and tail and (between or tail[0].isdigit()):
                groups.setdefault(("after", between + tail), {})[head] = label
    whole = {key for key, group in groups.items() if len(group) >= FEWEST_LABELS and not lacking(tuple(group))}
    # Without a complete subject, prefixes before a colon are those of incomplete ones if they share points.
    manners = {_manner(key) for key in whole} or {("before", ":")}
    alike = [key for key in groups if _manner(key) in manners]
    times = Counter(point for key in whole or alike for point in groups[key])
    shared = {point for point, count in times.items() if whole or count > 1}
    by_affix = {key: groups[key] for key in alike if key in whole or len(groups[key].keys() & shared) >= ALIKE}
    assigned = {label for group in by_affix.values() for label in group.values()}
    rest = {label: label for label in labels if label not in assigned}
    if by_affix and not lacking(tuple(rest)):
        by_affix["", ""] = rest
    place = {label: number for number, label in enumerate(labels)}
    first = {key: min(place[label] for label in group.values()) for key, group in by_affix.items()}
    order = sorted(by_affix, key=first.__getitem__)
    once = {frozenset(by_affix[key].values()): key for key in order}  # `LASI_2` is split before the sign and behind it
    names = numbered(printable(affix.strip(SIGNS))[:60] or "unnamed" for _, affix in once.values())
    return {name: by_affix[key] for name, key in zip(names, once.values(), strict=True)}


def _manner(affix: Affix) -> Affix:
    """The side on which an affix stands, and the signs between it and the point's name."""
    kind, text = affix
    match = re.search(rf"[{re.escape(SIGNS)}]*\Z" if kind == "before" else rf"\A[{re.escape(SIGNS)}]*", text)
    return kind, match[0] if match else ""
