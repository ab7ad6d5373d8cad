"""Descriptions: the grammar's sentences and their slots, the parser, diversity, files, the command."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from command_line import Command
from t2d_rt.core.errors import InputError
from t2d_rt.motion.descriptions import grammar, tokens
from t2d_rt.motion.descriptions.diversity import NEAREST, diversity
from t2d_rt.motion.descriptions.grammar import grammar_descriptions, rules
from t2d_rt.motion.descriptions.lexicon import Lexicon, forms, lexicon, packaged, with_article
from t2d_rt.motion.descriptions.parse import Parsed, parse_description
from t2d_rt.motion.descriptions.slots import (
    ACTIVITIES,
    FALL_TYPES,
    GAIT_TYPES,
    Activity,
    Description,
    Step,
    read_descriptions,
    write_descriptions,
)
from t2d_rt.motion.descriptions.tokens import tokens_of

COUNT = 200

TABLE_1 = """
left right clockwise counterclockwise anticlockwise forward back up down straight arm foot feet hand leg waist knee
stair chair floor ball handrail slowly carefully fast careful slow quick happily angry sad happy angrily sadly
"""
"""Words of Table I of the paper; its actions are slots."""

SLOTS = "manner", "direction", "speed", "body_part", "object", "type", "side", "count", "duration_s", "angle_deg"


@cache
def written(activity: Activity, seed: int = 0) -> list[Description]:
    return grammar_descriptions(activity, COUNT, seed=seed)


def said(step: Step) -> dict[str, Any]:
    """What a step says: its slots but the empty and the normal ones."""
    found = {name: getattr(step, name) for name in SLOTS if getattr(step, name) not in (None, "normal")}
    return {"action": step.action, **found}


def read(sentence: str) -> tuple[str, list[dict[str, Any]]]:
    found = parse_description(sentence).description
    return found.activity, [said(step) for step in found.steps]


# --- the grammar ---


@pytest.mark.parametrize("activity", ACTIVITIES)
def test_sentences_say_what_their_slots_say(activity: Activity) -> None:
    assert len(written(activity)) == COUNT
    for description in written(activity):
        assert description.activity == activity
        parsed = parse_description(description.sentence)
        assert parsed == Parsed(description), description.sentence


def test_the_grammar_writes_what_is_like_other_classes() -> None:
    """People who let themselves down, beside falls; who stand on one leg; who turn by an angle; who do it several times."""
    downs = [
        each for each in written("sitting") if (each.action, each.manner, each.speed) == ("lie_down", "careful", "slow")
    ]
    assert 20 <= len(downs) <= 45
    assert not any(parse_description(each.sentence).description.activity == "falling" for each in downs)
    assert 20 <= sum(each.action == "balance" for each in written("bending")) <= 40
    assert all(each.side for each in written("bending") if (each.action, each.body_part) == ("balance", "leg"))
    steps = [step for activity in ACTIVITIES for each in written(activity) for step in each.steps]
    # the filter asks of a walk and a run that the hips get on
    assert not any(step.direction == "in_place" for step in steps)
    assert {90.0, 180.0, 270.0, 360.0} <= {each.angle_deg for each in written("walking")}
    assert all(
        any(each.count for each in written(activity)) for activity in ("walking", "sitting", "bending", "jumping")
    )


@pytest.mark.parametrize("activity", ACTIVITIES)
def test_sentences_are_written_well(activity: Activity) -> None:
    for sentence in (each.sentence for each in written(activity)):
        known = re.sub(r"Parkinson's|Trendelenburg", "known", sentence, count=1)
        known = re.sub(r"by (90|180|270|360) degrees", "known", known, count=1)
        assert re.fullmatch(r"[A-Z][a-z' ,;-]*\.", known), sentence
        assert not re.search(r"\ba [aeiou]|\ban [^aeiou]", sentence, re.IGNORECASE), sentence
        assert not re.search(r"  | ,|\b(\w+) \1\b|,,|[{}|*~]", sentence), sentence
        assert 2 <= len(sentence.split()) <= 40


@pytest.mark.parametrize("activity", ACTIVITIES)
def test_no_two_sentences_are_near_duplicates(activity: Activity) -> None:
    sets = [set(re.findall(r"[a-z']+", each.sentence.lower())) for each in written(activity)]
    assert max(len(a & b) / len(a | b) for a, b in itertools.combinations(sets, 2)) < NEAREST


@pytest.mark.parametrize("activity", ACTIVITIES)
@pytest.mark.parametrize("seed", [0, 1])
def test_each_class_uses_all_that_its_plans_hold(activity: Activity, seed: int) -> None:
    for plan in rules().plans[activity]:
        found = [each for each in written(activity, seed) if (each.action, each.type) == (plan.action, plan.type)]
        for slot in ("manner", "direction", "speed", "object", "body_part"):
            wanted = {value for value in getattr(plan, slot) if value}
            rare = activity in ("abnormal_walking", "falling")  # of several types: all of them together have each
            pool = written(activity, seed) if rare else found
            assert wanted <= {getattr(each, slot) for each in pool}, (plan.action, plan.type, slot)


def test_every_word_of_the_table_is_used() -> None:
    everything = [each for activity in ACTIVITIES for each in written(activity)]
    words = {word for each in everything for word in re.findall(r"[a-z]+", each.sentence.lower())}
    missing = {word for word in TABLE_1.split() if not words & {word, word + "s"}}
    assert not missing
    actions = {step.action for each in everything for step in each.steps}
    assert actions == {"walk", "fall", "sit", "bend", "lie_down", "stand_up", "climb", "stretch", "squat", "dance", "run", "jump",
                       "turn", "stand", "balance"}  # fmt: skip
    assert {each.type for each in everything} == {None, *FALL_TYPES, *GAIT_TYPES}
    assert {each.subject for each in everything} == {"person", "man", "woman", "child", "old_person", "heavy_person"}


@pytest.mark.parametrize("seed", [0, 1])
def test_falls_and_gaits_have_their_types_evenly(seed: int) -> None:
    for activity, types in (("falling", FALL_TYPES), ("abnormal_walking", GAIT_TYPES)):
        found = [each.type for each in written(activity, seed)]  # type: ignore[arg-type]
        assert all(found.count(each) >= COUNT / len(types) - 3 for each in types)


def test_same_seed_same_sentences_and_more_begin_with_fewer() -> None:
    assert grammar_descriptions("falling", 20) == written("falling")[:20]
    assert grammar_descriptions("falling", 20, seed=3) != grammar_descriptions("falling", 20, seed=4)


@pytest.mark.parametrize(
    ("activity", "count", "message"),
    [
        ("flying", 3, "activity must be 'walking'.* got 'flying'"),
        ("falling", 0, "count must be an integer in 1..10000, got 0"),
        ("falling", 1.5, "count must be an integer"),
    ],
)
def test_unknown_classes_and_counts_are_refused(activity: Any, count: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        grammar_descriptions(activity, count)


def test_a_grammar_at_its_end_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grammar, "MOST_REFUSED", 1)
    with pytest.raises(InputError, match=r"found \d+ descriptions of dancing .* less than 80% alike, not 3000; ask"):
        grammar_descriptions("dancing", 3000)


def test_verbs_are_inflected() -> None:
    assert forms("slip") == ("slip", "slips", "slipping", "slipped", "slipped")
    assert forms("lie")[1:] == ("lies", "lying", "lay", "lain")
    assert forms("hurry")[1:4] == ("hurries", "hurrying", "hurried")
    assert forms("dance")[1:4] == ("dances", "dancing", "danced")
    assert forms("stretch")[1] == "stretches"
    assert forms("let")[1:] == ("lets", "letting", "let", "let")
    assert forms("slide")[1:] == ("slides", "sliding", "slid", "slid")
    assert (with_article("old man"), with_article("happy child")) == ("an old man", "a happy child")


def test_short_verbs_double_their_last_letter_or_are_irregular() -> None:
    words = lexicon()
    tables = [*words.weak_verbs.values(), *words.body_part_verbs.values(), words.limb_verbs, words.other_actions]
    tables += [phrases for verbs in words.verbs.values() for phrases in (verbs.said, verbs.understood)]
    verbs = {verb.split()[0] for phrases in tables for phrase in phrases for verb in phrase.split(" and ")}
    short = {verb for verb in verbs - {"hip"} if re.fullmatch(r"[^aeiou]*[aeiou][^aeiouwxy]", verb)}  # hip hop
    assert {"let", "slip", "slap"} <= short
    assert short <= {*words.irregular_verbs, *words.doubling_verbs}


# --- the lexicon ---


@pytest.mark.parametrize(
    ("section", "key", "value", "message"),
    [
        ("verbs", "ski", {"said": "ski"}, "verbs: 'ski' begins with no action; choose one of walk, fall"),
        ("verbs", "walk speed=brisk", {"said": "ski"}, "step key speed: got 'brisk'"),
        ("verbs", "walk", {"sung": "ski"}, "unknown entry of the lexicon key 'sung'"),
        ("modifiers", "manner=bored", {"adverbs": "boredly"}, "step key manner: got 'bored'"),
        ("objects", "table", "table | desk", "lexicon key objects"),
        (
            "negations",
            None,
            False,
            "a text with bars between them, got False; put .* quotation marks",
        ),  # what YAML makes of no
        ("irregular_verbs", "ski", "skis skiing", "ski needs four forms .* got 2"),
        ("verb", None, {}, "unknown lexicon key 'verb'; did you mean verbs"),
    ],
)
def test_mistakes_in_the_lexicon_are_one_sentence(section: str, key: str | None, value: Any, message: str) -> None:
    given = packaged("lexicon")
    if key is None:
        given[section] = value
    else:
        given[section][key] = value
    with pytest.raises(InputError, match=message) as refusal:
        Lexicon.model_validate(given)
    assert "\n" not in str(refusal.value)


def test_a_word_that_is_added_is_understood(monkeypatch: pytest.MonkeyPatch) -> None:
    given = packaged("lexicon")
    given["verbs"]["walk speed=fast"]["understood"] += " | skedaddle {his} way"
    monkeypatch.setattr(tokens, "lexicon", lambda: Lexicon.model_validate(given))
    for kept in (tokens._index, tokens._vocabulary):
        kept.cache_clear()
    try:
        (found,) = (each for each in tokens_of("skedaddling her way") if each.kind == "action")
    finally:
        for kept in (tokens._index, tokens._vocabulary):
            kept.cache_clear()
    assert (found.slots, found.gerund) == ({"action": "walk", "speed": "fast"}, True)


# --- the parser ---

WALK, FALL, SIT, UP = "walk", "fall", "sit", "stand_up"

SENTENCES = [
    ("A person walks slowly forward, slips and falls backward", "falling",
     [{"action": WALK, "speed": "slow", "direction": "forward"}, {"action": FALL, "type": "slip", "direction": "back"}]),
    ("an old man lowers himself gently to the floor", "sitting",
     [{"action": "lie_down", "object": "floor", "manner": "careful", "speed": "slow"}]),
    ("turns around on the spot to the left", "walking", [{"action": "turn", "direction": "left", "angle_deg": 180.0}]),
    ("turns by 270 degrees clockwise", "walking", [{"action": "turn", "direction": "clockwise", "angle_deg": 270.0}]),
    ("stands on his left leg for 5 s", "bending",
     [{"action": "balance", "body_part": "leg", "side": "left", "duration_s": 5.0}]),
    ("lies face down on the ground", "sitting", [{"action": "lie_down", "direction": "forward", "object": "floor"}]),
    ("lowers herself into a chair", "sitting",
     [{"action": SIT, "manner": "careful", "speed": "slow", "object": "chair"}]),
    ("does 20 squats", "bending", [{"action": "squat", "count": 20}]),
    ("gets down on her knees", "bending", [{"action": "squat"}]),
    ("jumps left on one leg", "jumping", [{"action": "jump", "direction": "left", "body_part": "leg"}]),
    ("walks on the spot, then forward", "walking",
     [{"action": WALK, "direction": "in_place"}, {"action": WALK, "direction": "forward"}]),
    ("walks and balances on one leg", "bending", [{"action": WALK}, {"action": "balance"}]),
    ("sits down on a chair and stands up again", "sitting", [{"action": SIT, "object": "chair"}, {"action": UP}]),
    ("walks in a circle clockwise", "walking", [{"action": WALK, "direction": "clockwise"}]),
    ("walks counter-clockwise", "walking", [{"action": WALK, "direction": "counterclockwise"}]),
    ("jumps up and down three times", "jumping", [{"action": "jump", "direction": "up", "count": 3}]),
    ("He does five jumping jacks.", "jumping", [{"action": "jump", "body_part": "arm", "count": 10}]),
    ("the man in the red shirt jogs for 5 seconds", "running", [{"action": "run", "speed": "slow", "duration_s": 5.0}]),
    ("runs for half an hour, then walks for 2 minutes", "running",
     [{"action": "run"}, {"action": WALK, "duration_s": 120.0}]),
    ("HE TIPTOES.", "walking", [{"action": WALK, "manner": "careful"}]),
    ("someone sprints", "running", [{"action": "run", "speed": "fast"}]),
    ("strolls quickly", "walking", [{"action": WALK, "speed": "fast"}]),
    ("a kid hops on his left foot", "jumping", [{"action": "jump", "body_part": "foot", "side": "left"}]),
    ("A woman trips over a chair", "falling", [{"action": FALL, "type": "trip", "object": "chair"}]),
    ("he slipped on the wet floor and landed on his back", "falling",
     [{"action": FALL, "type": "slip", "direction": "back"}]),
    ("she faints", "falling", [{"action": FALL, "type": "collapse"}]),
    ("keels over", "falling", [{"action": FALL}]),
    ("he stumbles", "falling", [{"action": FALL, "type": "trip"}]),
    ("this person stumbles left and right while moving forward.", "abnormal_walking",
     [{"action": WALK, "type": "ataxic", "direction": "forward"}]),
    ("takes a seat on the bench", "sitting", [{"action": SIT, "object": "chair"}]),
    ("gets slowly up from the floor", "sitting", [{"action": UP, "speed": "slow", "object": "floor"}]),
    ("lies down on his back", "sitting", [{"action": "lie_down", "direction": "back"}]),
    ("A man lying on the floor gets up", "sitting", [{"action": UP, "object": "floor"}]),
    ("bends over and picks up the ball", "bending", [{"action": "bend", "object": "ball"}]),
    ("a man bends down and picks something up with his left hand.", "bending",
     [{"action": "bend", "direction": "down", "body_part": "hand", "side": "left"}]),
    ("stoops, bows", "bending", [{"action": "bend"}]),
    ("crouches", "bending", [{"action": "squat"}]),
    ("kneels on the right knee", "bending", [{"action": "squat", "body_part": "knee", "side": "right"}]),
    ("a person is stretching their arms.", "bending", [{"action": "stretch", "body_part": "arm"}]),
    ("waltzes clockwise", "dancing", [{"action": "dance", "direction": "clockwise"}]),
    ("dances, turning anticlockwise", "dancing", [{"action": "dance", "direction": "counterclockwise"}]),
    ("A person is doing a hip hop dance", "dancing", [{"action": "dance"}]),
    ("limps on his left leg", "abnormal_walking",
     [{"action": WALK, "type": "limping", "body_part": "leg", "side": "left"}]),
    ("walks with the gait of Parkinson's", "abnormal_walking", [{"action": WALK, "type": "parkinsonian"}]),
    ("a patient with Parkinson's shuffles to a chair and sits", "abnormal_walking",
     [{"action": WALK, "type": "parkinsonian", "object": "chair"}, {"action": SIT}]),
    ("walks with foot drop", "abnormal_walking", [{"action": WALK, "type": "steppage"}]),
    ("a high-stepping gait", "abnormal_walking", [{"action": WALK, "type": "steppage"}]),
    ("a toddler waddles", "abnormal_walking", [{"action": WALK, "type": "waddling"}]),
    ("walks with knees crossing at each step, scissoring", "abnormal_walking", [{"action": WALK, "type": "scissor"}]),
    ("a drunk man walks", "abnormal_walking", [{"action": WALK, "type": "ataxic"}]),
    ("festinates", "abnormal_walking", [{"action": WALK, "type": "festinating"}]),
    ("has a parkinsonian gait with freezing", "abnormal_walking", [{"action": WALK, "type": "freezing"}]),
    ("walks up the stairs holding the handrail", "walking",
     [{"action": "climb", "direction": "up", "object": "handrail"}]),
    ("After walking forward, a man falls", "falling", [{"action": WALK, "direction": "forward"}, {"action": FALL}]),
    ("A man falls after walking forward", "falling", [{"action": WALK, "direction": "forward"}, {"action": FALL}]),
    ("Before sitting down, he walks to the chair", "sitting", [{"action": WALK, "object": "chair"}, {"action": SIT}]),
    ("he slips while walking", "falling", [{"action": WALK}, {"action": FALL, "type": "slip"}]),
    ("a sad man falls, then slowly gets up", "falling",
     [{"action": FALL, "manner": "sad"}, {"action": UP, "speed": "slow"}]),
    ("walks forward then backward", "walking",
     [{"action": WALK, "direction": "forward"}, {"action": WALK, "direction": "back"}]),
    ("marches forward, turns around, and then marches back", "walking",
     [{"action": WALK, "direction": "forward"}, {"action": "turn", "direction": "back"},
      {"action": WALK, "direction": "forward"}]),
    ("before she sits down she walks", "sitting", [{"action": WALK}, {"action": SIT}]),
    ("sits down, having walked", "sitting", [{"action": WALK}, {"action": SIT}]),
    ("5 s: walks; 10 s: sits", "sitting", [{"action": WALK, "duration_s": 5.0}, {"action": SIT, "duration_s": 10.0}]),
    ("sits after 10 s of walking", "sitting", [{"action": WALK, "duration_s": 10.0}, {"action": SIT}]),
    ("takes a step forward", "walking", [{"action": WALK, "direction": "forward"}]),
    ("takes one or two steps forward, then falls", "falling", [{"action": WALK, "direction": "forward"}, {"action": FALL}]),
    ("walks two or three steps back", "walking", [{"action": WALK, "direction": "back"}]),
    ("takes three or four small steps", "walking", [{"action": WALK}]),
    ("takes five or more steps forward", "walking", [{"action": WALK, "direction": "forward"}]),
    ("takes no seat but walks", "walking", [{"action": WALK}]),
    ("bends 3 times to the left side and to the right one", "bending",
     [{"action": "bend", "direction": "left", "count": 3}, {"action": "bend", "direction": "right", "count": 3}]),
    ("walks -> turns left", "walking", [{"action": WALK}, {"action": "turn", "direction": "left"}]),
    ("turns left and then right", "walking",
     [{"action": "turn", "direction": "left"}, {"action": "turn", "direction": "right"}]),
    ("A person runs forward and then leaps over an obstacle", "jumping",
     [{"action": "run", "direction": "forward"}, {"action": "jump"}]),
    ("a person stops walking and sits down", "sitting", [{"action": WALK}, {"action": "stand"}, {"action": SIT}]),
    ("walks, halts walking and sits down", "sitting", [{"action": WALK}, {"action": "stand"}, {"action": SIT}]),
    ("walks to the left hand side", "walking", [{"action": WALK, "direction": "left"}]),
    ("bends at the waist to the left", "bending", [{"action": "bend", "body_part": "waist", "direction": "left"}]),
    ("a person walks forward and stops", "walking", [{"action": WALK, "direction": "forward"}, {"action": "stand"}]),
]  # fmt: skip


@pytest.mark.parametrize(("sentence", "activity", "steps"), SENTENCES)
def test_free_sentences_are_understood(sentence: str, activity: str, steps: list[dict[str, Any]]) -> None:
    assert read(sentence) == (activity, steps)


@pytest.mark.parametrize(
    ("sentence", "subject"),
    [
        ("he walks", "man"), ("the lady walks", "woman"), ("an elderly woman walks", "old_person"), ("walks", "person"),
        ("a little boy walks", "child"), ("an obese man walks", "heavy_person"), ("my grandfather walks", "old_person"),
        ("he is an old man who walks", "old_person"), ("a woman walks, then he sits", "woman"),
    ],
)  # fmt: skip
def test_subjects_are_understood(sentence: str, subject: str) -> None:
    assert parse_description(sentence).description.subject == subject


@pytest.mark.parametrize(
    ("sentence", "ignored"),
    [
        ("the man in the red shirt walks", ("red", "shirt")),
        ("a person walks without falling", ("without", "falling")),
        ("She does not sit down but walks", ("not", "sit down")),
        ("A person walking backward points to the right side with their right hand",
         ("points", "to the right side", "right hand")),
        ("A man paces back and forth", ("back and forth",)),
        ("sits down and stands up after 5 seconds", ("after 5 seconds",)),
        ("slips on a banana peel, dropping his phone", ("dropping", "phone")),
        ("walks down the street", ("street", "down")),
        ("walks twice as fast", ("twice as",)),
        ("squats three times as fast", ("three times as",)),
        ("jumps 2x as high", ("2 x as",)),
        ("jumps three times higher", ("three times", "higher")),
        ("walks at twice the speed", ("twice",)),
        ("squats 5 times for 10 s each", ("for 10 s each",)),
        ("turns 90 degrees to the left or right", ("or", "right")),
        ("walks or runs and sits down", ("or", "runs")),
        ("does not walk or run but sits", ("not", "walk", "or", "run")),
        ("drunk, he falls", ("drunk",)),
        ("two people are dancing", ("two people",)),
        ("a man and a woman walk", ("woman",)),
        ("a child walks with her mother", ("mother",)),
        ("he walks past a woman who sits", ("woman",)),
        ("a boy and a girl jump", ("girl",)),
        ("one person walks and another sits", ("another",)),
        ("five men walk", ("five men",)),
        ("both men walk", ("both", "men")),
        ("people walk", ("people",)),
        ("a man walks, then she sits", ("she",)),
        ("grandma walks, then he sits", ("he",)),
        ("more he walks twice", ("more",)),
        ("the boy walks and the girl sits", ("girl",)),
        ("participant 12 sits down", ("participant", "12")),
        ("a right-handed man walks", ("right handed",)),
        ("stretches both arms", ()),
        ("walks more slowly", ()),
        ("takes three steps forward", ("three steps",)),
        ("walks five steps", ("five steps",)),
        ("takes a step back", ()),
        ("takes between two and four steps back", ("between two and four steps",)),
        ("makes no steps, he sits down", ("no", "steps")),
        ("does no squats but walks", ("no", "squats")),
        ("a man aged 70 falls", ("aged", "70")),
    ],
)  # fmt: skip
def test_what_is_not_understood_is_told(sentence: str, ignored: tuple[str, ...]) -> None:
    parsed = parse_description(sentence)
    assert parsed.ignored == ignored
    assert not ignored or f"not understood and left out: {', '.join(ignored)}" in str(parsed)


def test_misspelt_words_and_a_circle_are_told() -> None:
    parsed = parse_description("a person wlaks slwoly forwrad")
    assert said(parsed.description) == {"action": "walk", "speed": "slow", "direction": "forward"}
    assert parsed.read_as == (("wlaks", "walks"), ("slwoly", "slowly"), ("forwrad", "forward"))
    assert "read 'wlaks' as 'walks'" in str(parsed)
    assert parse_description("walks in a circle").read_as == (("in a circle", "in a counterclockwise circle"),)
    assert parse_description("fills a cup, then walks").ignored == ("fills", "cup")


@pytest.mark.parametrize(
    ("sentence", "message"),
    [
        ("", "a description needs words, got ''"),
        (" \n ", "a description needs words"),
        ("?!", "a description needs words"),
        ("12", "a description needs words"),
        ("walks " * 400, "at most 2000 characters, got 2399"),
        (7, "a description must be a text, got 7; write it as"),
        (None, "a description must be a text"),
        ("Человек идёт вперёд", "is an English sentence"),
        ("eine Person geht langsam", "no activity was understood .*eine, geht, langsam.*describe walking"),
        ("a person performs a cartwheel", "no activity was understood .*cartwheel"),
        ("a man", "tells no activity; describe walking"),
        ("turns his head left", "no activity was understood .*turns his head"),
        ("does ten sit-ups", "no activity was understood .*sit ups"),
        ("a man walks on his hands", "no activity was understood .*walks on his hands"),
        ("a man stands still", "standing only"),
        ("the person was pushed but did not fall", r"what does not happen, or nearly \(fall\)"),
        ("he nearly falls", "what does not happen"),
        ("nobody walks", r"what does not happen, or nearly \(walks\)"),
        ("a man walks while a woman sits down", r"what several people do \(man, woman\); describe one of them"),
        ("a boy walks and his wife falls", r"what several people do \(child, wife\)"),
        ("jumps -2 times", "numbers of a description are above 0, got -2;"),
        ("a person stumbles but regains his balance", r"what does not happen, or nearly \(stumbles\)"),
        ("slips but does not fall", "what does not happen"),
        ("walks forward backward", "contradictory: it says forward and back of one action"),
        ("runs left right", "contradictory: it says left and right"),
        ("slow fast run", "contradictory: it says slow and fast"),
        ("a happy man walks sadly", "contradictory: it says happy and sad"),
        ("slips and falls upwards", "nobody falls up"),
        ("runs 0 times", "1 to 100 times, got 0"),
        ("does zero squats", "1 to 100 times, got zero"),
        ("does 3 sets of 0 squats", "1 to 100 times, got 3 sets of 0"),
        ("jumps 2.5 times", "1 to 100 times, got 2.5"),
        ("jumps x1.5", "1 to 100 times, got x 1.5"),
        ("jumps x-3", "numbers of a description are above 0, got -3"),
        ("runs for 10000 seconds", "up to 600 s, got 10000 s"),
        ("walks for 0 seconds", "more than 0 and up to 600 s, got 0 seconds; write a longer time"),
        (", then ".join(["walks", "runs"] * 16), "at most 30 steps, got 32"),
    ],
)
def test_what_cannot_be_used_is_refused_in_a_sentence(sentence: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as refusal:
        parse_description(sentence)
    assert "\n" not in str(refusal.value)


SOME_WORDS = """
a man walks falls slips stumbles sits not slowly fast left right back forward up and then before after while , . without in
circle chair stairs handrail three times for 5 seconds turns dances limps drunk with hands his left knee picks gets jumps bends
lies down xyzzy \0 \u00e9
"""
WORDS = st.sampled_from(SOME_WORDS.split())


@settings(max_examples=150, deadline=None)
@given(st.lists(WORDS, max_size=25))
def test_any_words_are_read_or_refused(words: list[str]) -> None:
    sentence = " ".join(words)
    try:
        parsed = parse_description(sentence)
    except InputError:
        return
    assert Description.model_validate(parsed.description.model_dump(by_alias=True)) == parsed.description
    unknown = {each.words for each in tokens_of(sentence) if each.kind == "unknown"}
    assert unknown <= set(parsed.ignored)


# --- slots ---


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"action": "walk", "type": "slip"}, "type slip belongs to action fall"),
        ({"action": "fall", "type": "limping"}, "type limping belongs to action walk"),
        ({"action": "fall", "direction": "up"}, "action fall has no direction up; choose one of forward"),
        ({"action": "walk", "side": "left"}, "side left belongs to an arm"),
        ({"action": "walk", "count": 0}, "count"),
        ({"action": "fly"}, "action"),
        ({"action": "walk", "hat": "red"}, "unknown step key 'hat'"),
    ],
)
def test_contradictory_slots_are_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Step(**fields)


# --- diversity ---


def test_diversity_of_known_sentences() -> None:
    found = diversity(["a man walks", "a man runs", "a cat sleeps"])
    assert found.distinct_1 == 6 / 9
    assert found.distinct_2 == 5 / 6
    assert found.least_distance == pytest.approx(1 - 2 / 4)
    assert found.mean_distance == pytest.approx((0.5 + 0.8 + 0.8) / 3)
    assert diversity(["a man walks"] * 2).least_distance == pytest.approx(0)
    with pytest.raises(InputError, match="at least one word, got 0"):
        diversity([])


@pytest.mark.parametrize("activity", ACTIVITIES)
def test_sets_are_diverse(activity: Activity) -> None:
    found = diversity(written(activity))
    assert found.mean_distance > 0.84
    assert found.distinct_2 > 0.3


# --- files and the command ---


def test_files_hold_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "falls.jsonl"
    write_descriptions(path, written("falling"))
    assert read_descriptions(path) == written("falling")
    row = json.loads(path.read_text().splitlines()[0])
    assert next(iter(row)) == "class"
    assert set(row) == {"class", "action", "subject", "before", "after", "sentence", *SLOTS}
    with pytest.raises(InputError, match="exists already"):
        write_descriptions(path, [])
    path.write_text('{"class": "falling"}\n')
    with pytest.raises(InputError, match=r"line 1 of .*action is missing"):
        read_descriptions(path)
    path.write_text("\n")
    with pytest.raises(InputError, match="holds none"):
        read_descriptions(path)


def test_command_writes_classes(run: Command, tmp_path: Path) -> None:
    code, out, err = run(
        "describe", "--class", "Normal walking,sitting", "--class", "abnormal-walking", "-n", "5", "-o", "a.jsonl"
    )
    assert code == 0
    assert "15 descriptions" in out
    assert err.count("distinct-1") == 3
    found = read_descriptions("a.jsonl")
    assert [each.activity for each in found] == ["walking"] * 5 + ["sitting"] * 5 + ["abnormal_walking"] * 5
    assert found[0] == written("walking")[0]
    code, out, _ = run("describe", "--class", "all", "-n", "1")
    assert [json.loads(line)["class"] for line in out.splitlines()] == list(ACTIVITIES)


def test_command_reads_a_sentence(run: Command) -> None:
    code, out, err = run("describe", "a man in a hat slips on the stiars")
    assert code == 0
    assert json.loads(out)["type"] == "slip"
    assert "read 'stiars' as 'stairs'; not understood and left out: hat" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "no class given"),
        (["--class", "sit"], "unknown class 'sit'; did you mean sitting?"),
        (["--class", "falling", "-n", "0"], "count must be an integer in 1..10000"),
        (["--class", "falling", "-o", "falls.csv"], "a file of descriptions ends in .jsonl"),
        (["--class", "falling", "-o", "no/falls.jsonl"], "folder no does not exist"),
        (["--class", "falling", "--model", "m"], "--model is for a language model"),
        (["--class", "falling", "--source", "poet"], "source must be grammar or openai"),
        (["--class", "falling", "--source", "openai"], "no model given"),
        (["--class", "falling", "a man falls"], "either a sentence"),
        (["he does not fall"], "what does not happen"),
        ([""], "needs words"),
    ],
)
def test_command_refuses(refused: Callable[..., str], arguments: list[str], message: str) -> None:
    assert message in refused("describe", *arguments)
