"""The words of descriptions, from lexicon.yaml, and the forms of English verbs: walks, walking, walked; a or an.

>>> forms("slip")
Forms(base='slip', present='slips', gerund='slipping', preterite='slipped', participle='slipped')
>>> with_article("old man"), with_article("person")
('an old man', 'a person')
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, get_args

from pydantic import BeforeValidator

from t2d_rt.core.checks import shown
from t2d_rt.core.errors import InputError
from t2d_rt.core.files import read_yaml
from t2d_rt.motion.descriptions.slots import Action, BodyPart, Direction, FallType, GaitType, Object, Step, Subject
from t2d_rt.types.fields import Fields

VOWELS = "aeiou"

ACTIONS = *get_args(Action), "stumble"
"""Actions of verbs: those of slots, and stumbling, which ends in a fall or is an unsteady walk."""


def divided(text: Any) -> Any:
    """The phrases of a text, which bars divide: "go | come to a stop" is "go", "come to a stop"."""
    if not isinstance(text, str | list | tuple):
        raise InputError(
            f"a list of words must be a text with bars between them, got {shown(text)}; put words that YAML reads "
            "otherwise, as no, between quotation marks"
        )
    return tuple(phrase.strip() for phrase in text.split("|")) if isinstance(text, str) else text


def of_text(split: Callable[..., Any], *options: Any) -> Callable[[Any], Any]:
    """A validator that splits what is a text, `options` behind it, and leaves anything else to the checks that follow."""
    return partial(_split, split, options)


def _split(split: Callable[..., Any], options: tuple[Any, ...], value: Any) -> Any:
    return split(value, *options) if isinstance(value, str) else value


Phrases = Annotated[tuple[str, ...], BeforeValidator(divided)]
Words = Annotated[tuple[str, ...], BeforeValidator(of_text(str.split))]


class Synonyms(Fields):
    """Phrases of one meaning."""

    noun: ClassVar[str] = "entry of the lexicon"

    said: Phrases = ()
    """What the grammar writes, and the parser understands."""
    understood: Phrases = ()
    """What only the parser knows."""


class Modifier(Fields):
    """Words for a manner or a speed, by what the grammar does with them."""

    noun: ClassVar[str] = "modifier of the lexicon"

    adverbs: Phrases = ()
    before_verb: Phrases = ()
    """Adverbs that stand before a verb, too; all of them where none is given."""
    phrases: Phrases = ()
    adjectives: Phrases = ()
    """Adjectives of who moves."""
    understood: Phrases = ()
    """What only the parser knows."""


class Lexicon(Fields):
    """All words that the parser understands; lexicon.yaml says what each section holds."""

    noun: ClassVar[str] = "lexicon"

    verbs: dict[str, Synonyms]
    weak_verbs: dict[Action, Phrases]
    partly_made: Phrases
    limb_verbs: Phrases
    body_part_verbs: dict[BodyPart, Phrases]
    recovering: Phrases
    other_actions: Phrases
    stopping: Phrases
    waiting: Phrases
    auxiliary: Phrases
    near_falls: Phrases
    irregular_verbs: dict[str, Words]
    doubling_verbs: Words
    modifiers: dict[str, Modifier]
    negations: Phrases
    subjects: dict[Subject, Synonyms]
    several: Phrases
    pronouns: Phrases
    possessives: dict[Literal["his", "her"], Phrases]
    objects: dict[Object, Phrases]
    body_parts: dict[BodyPart, Phrases]
    directions: dict[Direction | Literal["circle"], Phrases]
    gaits: dict[GaitType, Synonyms]
    fall_causes: dict[FallType, Synonyms]
    joins: dict[Literal["then", "before", "after", "while", "and", "or", ","], Phrases]
    on_the_spot: Phrases
    storeys: Phrases
    without_meaning: Phrases
    reported: Phrases
    neutral: Words
    of_limbs: Words
    not_misspelt: Words
    numbers: dict[str, int]
    some: dict[str, int]
    times: dict[str, int]
    not_once: Words
    compared: Words
    seconds: dict[str, float]
    degrees: dict[str, float]
    roughly: Words

    def model_post_init(self, context: Any, /) -> None:
        """Checks what the names of entries tell: an action and a slot of it, or a slot."""
        for name in self.verbs:
            action, slots = meaning(name)
            if action not in ACTIONS:
                raise InputError(
                    f"lexicon key verbs: {name!r} begins with no action; choose one of {', '.join(ACTIONS)}"
                )
            Step.model_validate({"action": "fall" if action == "stumble" else action, **slots})
        for name in self.modifiers:
            Step.model_validate({"action": "walk", **meaning(name)[1]})
        for base, inflected in self.irregular_verbs.items():
            if len(inflected) != 4:
                raise InputError(
                    f"lexicon key irregular_verbs: {base} needs four forms (is being was been), got {len(inflected)}"
                )


def meaning(name: str) -> tuple[str, dict[str, str]]:
    """What the name of an entry tells.

    >>> meaning("walk speed=slow"), meaning("manner=sad")
    (('walk', {'speed': 'slow'}), ('', {'manner': 'sad'}))
    """
    words = name.split()
    said = dict(word.split("=", 1) for word in words if "=" in word)
    return " ".join(word for word in words if "=" not in word), said


@cache
def lexicon() -> Lexicon:
    """The lexicon that ships with the package."""
    return Lexicon.model_validate(packaged("lexicon"))


def packaged(name: str) -> dict[str, Any]:
    """The values of a YAML file beside this module."""
    path = Path(str(files("t2d_rt"))) / "motion" / "descriptions" / f"{name}.yaml"
    return read_yaml(path, noun=name, example="sections of words")


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
    if base in lexicon().irregular_verbs:
        return Forms(base, *lexicon().irregular_verbs[base])
    if base.endswith("y") and base[-2] not in VOWELS:
        return Forms(base, base[:-1] + "ies", base + "ing", base[:-1] + "ied", base[:-1] + "ied")
    present = base + ("es" if base.endswith(("s", "sh", "ch", "x", "z", "o")) else "s")
    stem = base + base[-1] if base in lexicon().doubling_verbs else base
    if base.endswith("e") and not base.endswith("ee"):
        return Forms(base, present, base[:-1] + "ing", base + "d", base + "d")
    preterite = base + "d" if base.endswith("ee") else stem + "ed"
    return Forms(base, present, stem + "ing", preterite, preterite)


def inflected(phrase: str, form: str) -> str:
    """A phrase that begins with an infinitive, with that verb in a form: present, gerund, preterite, participle or base."""
    verb, _, rest = phrase.partition(" ")
    return f"{getattr(forms(verb), form)} {rest}".strip()


@cache
def forms_of(verbs: tuple[str, ...]) -> frozenset[str]:
    """All forms of some verbs."""
    return frozenset(form for verb in verbs for form in forms(verb))


def with_article(noun: str) -> str:
    """A noun, with or without adjectives, behind "a" or "an"."""
    return f"{'an' if noun[0] in VOWELS else 'a'} {noun}"
