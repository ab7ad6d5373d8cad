"""Forms of English verbs and what goes with them: walks, walking, walked; a or an.

>>> forms("slip")
Forms(base='slip', present='slips', gerund='slipping', preterite='slipped', participle='slipped')
>>> with_article("old man"), with_article("person")
('an old man', 'a person')
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

IRREGULAR = {
    "be": "is being was been", "bear": "bears bearing bore borne", "begin": "begins beginning began begun",
    "bend": "bends bending bent "
        "bent", "bring": "brings bringing brought brought", "catch": "catches catching caught caught",
    "come": "comes coming came come", "creep": "creeps creeping crept crept", "do": "does doing did done",
    "draw": "draws drawing drew drawn", "drive": "drives driving drove driven", "fall": "falls falling fell fallen",
    "feel": "feels feeling felt felt", "get": "gets getting got gotten", "give": "gives giving gave given",
    "go": "goes going went gone", "have": "has having had had", "hold": "holds holding held held",
    "keep": "keeps keeping kept kept", "kneel": "kneels kneeling knelt knelt", "lean": "leans leaning leaned leant",
    "leap": "leaps leaping leapt leaped", "lie": "lies lying lay lain", "lose": "loses losing lost lost",
    "make": "makes making made made", "put": "puts putting put put", "rise": "rises rising rose risen",
    "run": "runs running ran run", "set": "sets setting set set", "shake": "shakes shaking shook shaken",
    "sit": "sits sitting sat sat", "speed": "speeds speeding sped sped", "spin": "spins spinning spun spun",
    "spring": "springs springing sprang "
        "sprung", "stand": "stands standing stood stood", "stride": "strides striding strode stridden",
    "sweep": "sweeps sweeping swept swept", "swim": "swims swimming swam swum", "swing": "swings swinging swung swung",
    "take": "takes taking took taken", "throw": "throws throwing threw thrown", "hit": "hits hitting hit hit",
    "bow": "bows bowing bowed "
        "bowed", "sway": "sways swaying swayed swayed", "tiptoe": "tiptoes tiptoeing tiptoed tiptoed",
    "eat": "eats eating ate eaten", "drink": "drinks drinking drank drunk", "fly": "flies flying flew flown",
}  # fmt: skip
"""Present, gerund, past and past participle of the verbs that do not follow the rules."""

_DOUBLED = """
jog trip slip hop step skip squat plod trot stop drop clap pat bob nod grab wrap tap flip drag strut skid scrub beg
jam
"""
DOUBLED = frozenset(_DOUBLED.split())
"""Verbs that double their last letter: slipping."""

AN_SOUND = "aeiou"


class Forms(NamedTuple):
    """The forms of a verb."""

    base: str
    present: str
    gerund: str
    preterite: str
    participle: str


@cache
def forms(base: str) -> Forms:
    """The forms of a verb, given as its infinitive; the present is that of he, she or it."""
    if base in IRREGULAR:
        return Forms(base, *IRREGULAR[base].split())
    if base.endswith("y") and base[-2] not in "aeiou":
        return Forms(base, base[:-1] + "ies", base + "ing", base[:-1] + "ied", base[:-1] + "ied")
    present = base + ("es" if base.endswith(("s", "sh", "ch", "x", "z", "o")) else "s")
    stem = base + base[-1] if base in DOUBLED else base
    if base.endswith("e") and not base.endswith("ee"):
        return Forms(base, present, base[:-1] + "ing", base + "d", base + "d")
    preterite = base + "d" if base.endswith("ee") else stem + "ed"
    return Forms(base, present, stem + "ing", preterite, preterite)


def with_article(noun: str) -> str:
    """A noun, with or without adjectives, behind "a" or "an"."""
    return f"{'an' if noun[0] in AN_SOUND else 'a'} {noun}"
