"""What follows a verb in the grammar's sentences: directions, objects and parts of the body, for each action.

`{his}` is the possessive of who moves; `{side} ` is "left " or "right " where the step tells the side, and nothing elsewhere.
"""

from __future__ import annotations

_ROUND = {
    "clockwise": "clockwise | in a clockwise circle | clockwise in a circle",
    "counterclockwise": "counterclockwise | anticlockwise | in an anticlockwise circle | counterclockwise in a circle",
}
_LEVEL = {
    "forward": "forward*3 | forwards | ahead",
    "back": "backward*2 | backwards | back",
    "left": "to the left*2 | to {his} left | left",
    "right": "to the right*2 | to {his} right | right",
    "straight": "straight ahead*2 | straight on | in a straight line | straight",
}
_VERTICAL = {"up": "up | upward", "down": "down | downward"}
_LYING = {
    "back": "on {his} back | flat on {his} back",
    "left": "on {his} left side",
    "right": "on {his} right side",
    "forward": "on {his} stomach | face down",
}

DIRECTION = {
    "walk": {**_LEVEL, **_ROUND, **_VERTICAL},
    "run": {**_LEVEL, **_ROUND},
    "turn": {"left": "left | to the left", "right": "right | to the right", "back": "back | backward", **_ROUND},
    "climb": _VERTICAL,
    "fall": {**_LEVEL, "back": "backward*2 | backwards | on {his} back | back", "down": "down | straight down | in a heap",
             "forward": "forward*3 | forwards | "
                 "face down", "left": "to the left*2 | onto {his} left side", "straight": "straight ahead",
             "right": "to the right*2 | onto {his} right side"},
    "sit": {"back": "backward | backwards"},
    "lie_down": _LYING,
    "stand_up": {},
    "bend": {**_LEVEL, **_VERTICAL, "forward": "forward*3 | forwards"},
    "squat": {},
    "stretch": {**_LEVEL, "forward": "forward", "up": "upward | upwards | up", "down": "downward | down"},
    "jump": {**_LEVEL, **_ROUND, "up": "up*2 | into the air | upward | high", "down": "down"},
    "dance": {**_LEVEL, **_ROUND, "straight": "in a straight line", "up": "up and down"},
}  # fmt: skip

_TO_CHAIR = "to a chair | towards a chair | past a chair | to an armchair | towards a bench"
_HOLDING = "holding the handrail | holding on to a handrail"

OBJECT = {
    ("walk", "chair"): _TO_CHAIR,
    ("walk", "ball"): "towards a ball | past a ball | carrying a ball",
    ("walk", "floor"): "across the floor | over the carpet",
    ("walk", "stair"): "to the stairs | past the stairs | towards a staircase",
    ("walk", "handrail"): "along a handrail | holding a handrail",
    ("run", "chair"): _TO_CHAIR,
    ("run", "ball"): "towards a ball | to a ball | past a ball",
    ("run", "floor"): "across the floor | over the ground",
    ("run", "stair"): "to the stairs | past the stairs | towards a stair",
    ("run", "handrail"): "along a handrail | to a handrail",
    ("turn", "chair"): "beside a chair | towards a chair | in front of a chair",
    ("turn", "handrail"): _HOLDING,
    ("climb", "stair"): "",
    ("climb", "handrail"): _HOLDING,
    ("fall", "floor"): "onto the floor | to the floor | to the ground | on the floor",
    ("fall", "stair"): "on the stairs | on a stair",
    ("fall", "ball"): "on a ball",
    ("fall", "chair"): "beside a chair | off a chair | from a chair",
    ("fall", "handrail"): "beside a handrail | holding a handrail",
    ("sit", "chair"): "on a chair*3 | in an armchair | on a stool | on a bench",
    ("sit", "floor"): "on the floor | on the ground | on a mat",
    ("sit", "stair"): "on a stair | on the stairs",
    ("sit", "ball"): "on a ball",
    ("sit", "handrail"): "beside a handrail | holding a handrail",
    ("stand_up", "chair"): "from a chair*2 | from an armchair | out of a chair | from a stool",
    ("stand_up", "floor"): "from the floor | from the ground",
    ("stand_up", "stair"): "from the stairs | from a stair",
    ("stand_up", "handrail"): _HOLDING,
    ("lie_down", "floor"): "on the floor | on the ground | on a mat",
    ("lie_down", "chair"): "on a couch | on a sofa | on a bed",
    ("bend", "ball"): "to pick up a ball | towards a ball | over a ball | to pick a ball up from the floor",
    ("bend", "floor"): "to touch the floor | towards the floor | to pick something up from the floor",
    ("bend", "chair"): "over a chair | behind a chair | to touch a chair",
    ("bend", "handrail"): "over a handrail | holding a handrail",
    ("bend", "stair"): "over a stair | on the stairs",
    ("squat", "ball"): "to pick up a ball | beside a ball",
    ("squat", "floor"): "on the floor | to touch the floor",
    ("squat", "chair"): "beside a chair | in front of a chair | behind a chair",
    ("squat", "handrail"): _HOLDING,
    ("stretch", "floor"): "on the floor | towards the floor",
    ("stretch", "chair"): "beside a chair | behind a chair",
    ("stretch", "handrail"): _HOLDING,
    ("jump", "ball"): "over a ball | past a ball",
    ("jump", "chair"): "beside a chair | in front of a chair",
    ("jump", "floor"): "on the floor | across the floor",
    ("jump", "stair"): "beside the stairs",
    ("dance", "floor"): "across the floor | on the floor",
    ("dance", "chair"): "beside a chair | behind a chair",
    ("dance", "ball"): "with a ball | holding a ball",
}

OBJECT_OF_TYPE = {
    ("trip", "chair"): "over a chair | over a stool",
    ("trip", "ball"): "over a ball",
    ("trip", "stair"): "on a stair | over a stair",
    ("collapse", "chair"): "beside a chair | in front of a chair",
}
"""Of falls that come about in some way; OBJECT elsewhere."""

_CIRCLING = {
    ("chair", "clockwise"): "around a chair",
    ("chair", "counterclockwise"): "around a chair",
    ("ball", "clockwise"): "around a ball",
    ("ball", "counterclockwise"): "around a ball",
}

OBJECT_OF_DIRECTION = {
    **{(action, *key): phrase for action in ("walk", "run", "jump", "dance") for key, phrase in _CIRCLING.items()},
    ("jump", "stair", "up"): "onto a stair",
    ("jump", "stair", "down"): "from a stair",
    ("jump", "chair", "down"): "from a chair",
    ("jump", "chair", "up"): "onto a chair",
}
"""Of a direction; OBJECT elsewhere."""

_ARMS = "swinging {his} arms | with raised arms | with one arm raised | holding {his} arms out"

BODY = {
    ("walk", "arm"): _ARMS,
    ("walk", "hand"): "with {his} hands in {his} pockets | with one hand raised | holding up one hand",
    ("walk", "foot"): "on the tips of {his} toes | on {his} heels | with light feet",
    ("walk", "leg"): "lifting {his} legs | on tired legs",
    ("walk", "knee"): "lifting {his} knees | with stiff knees",
    ("walk", "waist"): "swaying at the waist",
    ("run", "arm"): "pumping {his} arms | " + _ARMS,
    ("run", "hand"): "with clenched fists | with one hand raised | with bare hands",
    ("run", "foot"): "on light feet | on the tips of {his} toes | with heavy feet",
    ("run", "leg"): "on tired legs | with stiff legs",
    ("run", "knee"): "lifting {his} knees | with stiff knees",
    ("turn", "foot"): "on one foot | on {his} heels | on {his} {side} foot",
    ("climb", "hand"): "with one hand on the wall | with one hand raised",
    ("climb", "foot"): "on the tips of {his} toes | with heavy feet",
    ("fall", "hand"): "onto {his} hands | landing on {his} {side} hand",
    ("fall", "knee"): "onto {his} knees | landing on {his} {side} knee",
    ("fall", "arm"): "landing on {his} {side} arm | with {his} arms in front | with both arms raised",
    ("fall", "leg"): "landing on {his} {side} leg",
    ("fall", "foot"): "lifting {his} {side} foot | landing on {his} {side} foot",
    ("fall", "waist"): "landing on {his} hip",
    ("sit", "hand"): "with {his} hands on {his} lap | resting both hands on {his} lap",
    ("sit", "knee"): "with {his} knees together | with crossed knees",
    ("sit", "arm"): "with folded arms | crossing {his} arms",
    ("sit", "leg"): "with crossed legs | crossing {his} legs | with {his} legs apart",
    ("sit", "foot"): "with {his} feet together | with {his} feet apart | crossing {his} feet",
    ("stand_up", "hand"): "with the help of {his} hands | with the help of one hand",
    ("stand_up", "knee"): "on stiff knees | with shaky knees",
    ("stand_up", "leg"): "on shaky legs | on stiff legs",
    ("stand_up", "arm"): "with folded arms | crossing {his} arms",
    ("lie_down", "arm"): "with {his} arms apart | with folded arms",
    ("lie_down", "leg"): "with {his} legs apart | with crossed legs",
    ("lie_down", "hand"): "with {his} hands under {his} head | with folded hands",
    ("lie_down", "knee"): "with raised knees | with {his} knees together",
    ("bend", "waist"): "at the waist | from the waist",
    ("bend", "knee"): "at the knees | with stiff knees | with soft knees",
    ("bend", "hand"): "with {his} {side} hand held out | with both hands held out",
    ("bend", "arm"): "with hanging arms | with {his} {side} arm held out",
    ("bend", "leg"): "with stiff legs | with {his} legs apart",
    ("bend", "foot"): "with {his} feet apart | with {his} feet together",
    ("squat", "knee"): "with {his} knees apart | with {his} knees together",
    ("squat", "arm"): "with folded arms | holding {his} arms out",
    ("squat", "hand"): "with folded hands | with both hands held out",
    ("squat", "leg"): "with {his} legs apart | with {his} legs together",
    ("squat", "foot"): "with {his} feet apart | on the tips of {his} toes",
    ("jump", "foot"): "on one foot | on {his} {side} foot",
    ("jump", "leg"): "on one leg | on {his} {side} leg",
    ("jump", "arm"): _ARMS,
    ("jump", "knee"): "drawing up {his} knees | with stiff knees",
    ("jump", "hand"): "clapping {his} hands | raising {his} {side} hand",
    ("dance", "arm"): _ARMS + " | waving {his} arms",
    ("dance", "hand"): "clapping {his} hands | raising {his} {side} hand | with bare hands",
    ("dance", "leg"): "kicking {his} legs | lifting {his} {side} leg | lifting one leg",
    ("dance", "foot"): "tapping {his} {side} foot | on light feet | on the tips of {his} toes",
    ("dance", "waist"): "swaying at the waist | swinging {his} hips | rolling {his} hips",
    ("dance", "knee"): "lifting {his} knees | with soft knees",
}

BODY_OF_TYPE = {
    ("parkinsonian", "arm"): "hardly swinging {his} arms | hardly moving {his} arms",
    ("parkinsonian", "hand"): "with trembling hands | with {his} {side} hand trembling",
    ("parkinsonian", "foot"): "hardly lifting {his} feet",
    ("festinating", "foot"): "hardly lifting {his} feet | on the tips of {his} toes",
    ("festinating", "arm"): "hardly swinging {his} arms",
    ("freezing", "leg"): "with trembling legs | with stiff legs",
    ("freezing", "foot"): "hardly lifting {his} feet | with heavy feet",
    ("waddling", "waist"): "swaying at the waist | rolling {his} hips",
    ("waddling", "arm"): "holding {his} arms out",
    ("waddling", "leg"): "with {his} legs apart",
    ("ataxic", "arm"): "holding {his} arms out for balance | with {his} arms held out",
    ("ataxic", "foot"): "with {his} feet far apart",
    ("ataxic", "leg"): "with {his} legs far apart | on shaky legs",
    ("scissor", "knee"): "with {his} knees pressed together | with stiff knees",
    ("scissor", "leg"): "with stiff legs | with {his} legs pressed together",
    ("steppage", "foot"): "with {his} {side} foot dangling | with {his} {side} foot hanging",
    ("steppage", "knee"): "lifting {his} {side} knee | lifting {his} knees",
    ("steppage", "leg"): "lifting {his} {side} leg | lifting {his} legs",
    ("limping", "leg"): "sparing {his} {side} leg | with a painful {side} leg | with {his} {side} leg stiff",
    ("limping", "foot"): "sparing {his} {side} foot | with a painful {side} foot",
    ("limping", "knee"): "sparing {his} {side} knee | with a painful {side} knee | with {his} {side} knee stiff",
    ("limping", "hand"): "with one hand held out | with {his} {side} hand on a stick",
}
"""Of disturbed gaits; BODY elsewhere."""

STRETCHED = {
    "arm": "{his} arms | both arms | {his} {side} arm",
    "leg": "{his} legs | one leg | {his} {side} leg",
    "hand": "{his} hands | both hands",
    "foot": "{his} feet | {his} {side} foot",
    "knee": "{his} knees",
    "waist": "from the waist",
}
"""What somebody stretches: it follows the verb at once."""

ON_STAIRS = (
    "climb {way} the stairs*2 | walk {way} the stairs | go {way} the stairs | "
    "climb {way} a flight of stairs | walk {way} a staircase"
)
"""Climbing: {way} is up or down."""
