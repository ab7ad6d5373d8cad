"""What a joint's name says: its side and the parts of the body that it may stand for.

Names are split at capitals, digits and signs, and runs of letters are cut into known words, so that `LeftUpLeg`, `lThighBend`,
`Bip01 L Thigh`, `thigh_l`, `relbow` and `左ひざ` are all understood. One word can mean two joints (a `LeftShoulder` is a collar
or the top of the upper arm), so a name has several parts; where the joint lies decides between them.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from functools import cache

LONGEST_NAME = 80
"""Characters of a name that are read."""

_TABLE = {
    "left": "l left lft links linke linker linkes gauche izquierda izquierdo izq sinistra sinistro sx esquerda esquerdo 左 hidari",
    "right": "r right rgt rght rechts rechte rechter rechtes droite droit derecha derecho destra destro dx direita direito 右 migi",
    "pelvis": "pelvis pelv hips becken bassin bacino 骨盤 腰 下半身 koshi",
    "hip": "hip huefte hufte huften hueften hanche cadera anca 股関節 股",
    "thigh": "thigh femur buttock oberschenkel cuisse muslo coscia 太もも もも 大腿",
    "knee": "knee shin calf tibia crus unterschenkel knie genou mollet rodilla ginocchio ひざ 膝 すね 小腿 hiza",
    "leg": "leg bein jambe pierna gamba 足 脚 ashi",
    "ankle": "ankle knochel knoechel fussgelenk cheville tobillo caviglia 足首 ashikubi",
    "foot": "foot feet fuss pied pie piede heel talus",
    "toe": "toe toes ball toebase zehe zehen orteil orteils つま先 tsumasaki metatarsal metatarsals",
    "clavicle": "clavicle clav collar schlusselbein schluesselbein clavicule clavicula clavicola scapula 鎖骨",
    "shoulder": "shoulder shldr shoul schulter epaule hombro spalla 肩 kata",
    "upperarm": "humerus oberarm 上腕 上臂",
    "arm": "arm bras brazo braccio 腕 ude",
    "elbow": "elbow radius forearm unterarm ellbogen ellenbogen avantbras coude antebrazo codo avambraccio gomito "
    "ひじ 肘 hiji 前腕 前臂",
    "wrist": "wrist handgelenk poignet muneca polso 手首 tekubi",
    "hand": "hand main mano 手 palm carpus",
    "finger": "finger fingers thumb index ring pinky pinkie little metacarpal metacarpals knuckle daumen pouce pulgar dedo "
    "親指 人指 人差指 薬指 小指 指 digit phalanx",
    "middle": "middle mid mittelfinger 中指",
    "spine": "spine chest torso back abdomen thorax waist belly stomach sternum stern ribs lumbar trunk wirbelsaule "
    "wirbelsaeule wirbel brust brustkorb bauch colonne dos torse poitrine columna pecho colonna torace 上半身 胸 背骨 mune",
    "neck": "neck cervical hals nacken cou cuello collo 首 kubi",
    "head": "head skull kopf tete cabeza testa 頭 atama",
    "face": "eye eyes eyebrow eyelid jaw chin lip lips brow nose teeth tongue ear ears cheek lid forehead mouth face 目 両目",
    "root": "root reference armature world origin trajectory cog center centre master scene センター 全ての親 グルーブ",
    "twist": "twist roll share 捩",
    "helper": "ik fk pole target ctrl control weapon prop sword gun hair skirt cloth breast bust tail wing hind hat camera "
    "rigmesh mesh geo effector physics bag cape attach socket",
    "up": "up upper top high ober",
    "low": "low lower down unter",
    "fore": "fore front avant",
    "end": "end tip nub site effektor endsite",
    "plain": "bend joint jnt bone base cc def org mixamorig bip bip01 character skel rig human male female valve biped anim",
}

PARTS_OF_LEG = frozenset({"hip", "knee", "ankle", "foot", "toe"})
PARTS_OF_ARM = frozenset({"collar", "shoulder", "elbow", "wrist", "hand"})

VERTEBRA = re.compile(r"[jJ]?[LTS]\d{1,2}([LTS]\d{1,2})?")
CERVICAL = re.compile(r"[jJ]?C[1-7]([CT]\d)?(Head)?")
RUN = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+|[^\W\d_a-zA-Z]+")


@dataclass(frozen=True, slots=True)
class Label:
    """What a name says."""

    side: str | None = None
    """"left", "right" or nothing."""
    parts: frozenset[str] = frozenset()
    """Canonical joints without side, and "spine", "face", "root", "twist", "helper"; empty where the name says nothing."""
    middle: bool = False
    """A middle finger."""


def label(name: str) -> Label:
    """Side and parts of a joint's name; end sites (`<parent>:end`) say nothing."""
    if name.endswith(":end"):
        return Label()
    own = _plain(name[-LONGEST_NAME:].rpartition(":")[2])
    if VERTEBRA.fullmatch(own):
        return Label(parts=frozenset({"spine"}))
    if CERVICAL.fullmatch(own):
        return Label(parts=frozenset({"neck"}))
    kinds = [kind for run in RUN.findall(own) for kind in _kinds(run.casefold())]
    sides = {kind for kind in kinds if kind in ("left", "right")}
    side = sides.pop() if len(sides) == 1 else None
    return Label(side=side, parts=_parts(set(kinds), side), middle="middle" in kinds)


def _parts(kinds: set[str], side: str | None) -> frozenset[str]:
    """Rules from the most telling kind of word to the least."""
    end = "end" in kinds
    if side is None and "spine" in kinds:  # Kinect's SpineShoulder
        return frozenset({"spine"})
    rules = (
        ("helper", {"helper"}),
        ("finger", {"hand"}),
        ("middle", {"hand"} if not kinds & {"spine", "neck"} else {"spine"}),
        ("face", {"face"}),
        ("toe", {"toe"} if end else {"foot", "toe"}),
        ("ankle", {"ankle"}),
        ("foot", {"foot", "toe"} if end else {"ankle", "foot"}),
        ("wrist", {"wrist"}),
        ("hand", {"hand"} if end else {"wrist", "hand"}),
        ("thigh", {"hip"}),
        ("knee", {"knee"}),
        ("leg", {"hip"} if "up" in kinds else {"knee"} if "low" in kinds else {"hip", "knee"}),
        ("elbow", {"elbow"}),
        ("upperarm", {"shoulder"}),
        ("arm", {"elbow"} if kinds & {"low", "fore"} else {"shoulder"}),
        ("clavicle", {"collar"}),
        ("shoulder", {"collar", "shoulder"}),
        ("head", {"head_top"} if kinds & {"end", "up"} else {"head"}),
        ("neck", {"neck"}),
        ("spine", {"spine"}),
        ("hip", {"hip"} if side else {"pelvis"}),
        ("pelvis", {"pelvis"} if not side else set()),
        ("root", {"root"}),
    )
    found = next((parts for kind, parts in rules if kind in kinds), set[str]())
    if "twist" in kinds and found <= {"hip", "knee", "shoulder", "elbow"}:
        return frozenset({"twist"}) | found
    return frozenset(found)


def _plain(text: str) -> str:
    """Letters without accents; of Japanese signs the voicing marks go too, in names and table alike."""
    spread = unicodedata.normalize("NFKD", text.replace("ß", "ss"))
    return "".join(sign for sign in spread if not unicodedata.combining(sign))


@cache
def _vocabulary() -> dict[str, str]:
    return {_plain(word).casefold(): kind for kind, words in _TABLE.items() for word in words.split()}


def _kinds(run: str) -> list[str]:
    """Kinds of the fewest known words that make up a run of letters; none where it is not made of them."""
    words = _vocabulary()
    best: list[list[str] | None] = [[], *[None] * len(run)]
    for stop in range(1, len(run) + 1):
        for start in range(max(0, stop - 20), stop):
            word, before = run[start:stop], best[start]
            # A letter is a side at either end only: every word has an l or an r somewhere.
            if (
                before is None
                or word not in words
                or (len(word) == 1 and word in "lr" and start > 0 and stop < len(run))
            ):
                continue
            now = best[stop]
            if now is None or len(before) + 1 < len(now):
                best[stop] = [*before, words[word]]
    return best[-1] or []
