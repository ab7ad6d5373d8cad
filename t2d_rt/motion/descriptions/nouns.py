"""Who moves, with what, where to and in what way: nouns, directions and gaits by the slots that they fill (see lexicon)."""

from __future__ import annotations

SUBJECTS = {
    "person": "person | someone | adult",
    "man": "man | young man",
    "woman": "woman | young woman",
    "child": "child | boy | girl",
    "old_person": "old man | old woman | elderly man | elderly woman | elderly person",
    "heavy_person": "heavy man | heavy woman | heavy person | overweight man | overweight woman",
}
"""Who moves, as the grammar writes it."""

MORE_SUBJECTS = {
    "person": "somebody | individual | subject | patient | human | people | figure | walker | pedestrian | dancer | "
    "runner | they | i | you | we | "
    "adult person | teenager | athlete | worker | nurse | player | young person | everyone | actor | user | zombie | "
    "character | persons",
    "man": "he | guy | gentleman | male | men | lad | fellow | father | husband | boyfriend",
    "woman": "she | lady | female | women | mother | wife | girlfriend",
    "child": "kid | toddler | children | little boy | little girl | young boy | young girl | small child | "
    "schoolboy | schoolgirl",
    "old_person": "old person | old lady | old gentleman | elder | senior | pensioner | grandmother | grandfather | "
    "grandma | grandpa | "
    "granny | grandad | elderly lady | elderly gentleman | senior citizen | old people | aged man | aged woman | "
    "aged person | "
    "frail man | frail woman | frail person | elderly patient | elderly subject | the elderly | older man | "
    "older woman | older person | "
    "older adult | elderly adult",
    "heavy_person": "fat man | fat woman | fat person | obese man | obese woman | obese person | overweight person | "
    "large man | "
    "large woman | large person | big man | big woman | stout man | stout woman | stout person | corpulent man | "
    "heavyset man | "
    "heavyset woman | heavyset person | plump man | plump woman | plump person",
}

HIS = {
    **dict.fromkeys(("man", "young man", "boy", "old man", "elderly man", "heavy man", "overweight man"), "his"),
    **dict.fromkeys(
        ("woman", "young woman", "girl", "old woman", "elderly woman", "heavy woman", "overweight woman"), "her"
    ),
}
"""Possessives of those that the grammar writes; their, elsewhere."""

OBJECTS = {
    "chair": "chair | armchair | stool | chairs | seat | bench | sofa | couch | bed | chair's",
    "ball": "ball | football | basketball | balls | tennis ball | soccer ball",
    "handrail": "handrail | handrails | banister | bannister | railing | hand rail | rail",
    "stair": "stair | stairs | staircase | stairway | stairwell | flight of stairs | the steps | flight of steps | "
    "a step | steps of the stairs | "
    "a stair step | stairsteps | bottom step | top step | ladder | staircases",
    "floor": "floor | ground | carpet | mat | floors | the pavement",
}
"""Objects, the one that a step is about before others: a ball on the floor is a ball."""

PARTS = {
    "arm": "arm | arms | elbow | elbows | forearm | forearms",
    "hand": "hand | hands | palm | palms | finger | fingers | fist | fists | wrist | wrists",
    "foot": "on one foot | foot | feet | toe | toes | heel | heels | ankle | ankles | tiptoes",
    "leg": "on one leg | leg | legs | thigh | thighs | calf",
    "knee": "knee | knees",
    "waist": "waist | hip | hips | midriff",
}

DIRECTIONS = {
    "forward": "forward | forwards | ahead | onward | onwards | to the front | face down | on {his} stomach | "
    "onto {his} stomach | "
    "on {his} belly | face first | on {his} face | onto {his} face | on {his} front",
    "back": "back | backward | backwards | rearward | on {his} back | onto {his} back | face up | "
    "flat on {his} back | to the rear | "
    "on {his} backside | onto {his} backside | on {his} bottom | onto {his} bottom | behind {him}",
    "left": "left | leftward | leftwards | to the left | to {his} left | on the left | on {his} left side | "
    "onto {his} left side | to the left side | "
    "to {his} left side | towards the left | on {his} left | "
    "to {his} left hand side | on {his} left hand side",
    "right": "right | rightward | rightwards | to the right | to {his} right | on the right | on {his} right side | "
    "onto {his} right side | "
    "to the right side | to {his} right side | towards the right | on {his} right | "
    "to {his} right hand side | on {his} right hand side",
    "straight": "straight | straight ahead | straight forward | straight on | in a straight line | "
    "along a straight line | straight away",
    "clockwise": "clockwise | in a clockwise circle | in clockwise circles | in a circle clockwise | "
    "clockwise in a circle | in a clockwise direction | "
    "clockwise in circles",
    "counterclockwise": "counterclockwise | anticlockwise | counter clockwise | anti clockwise | "
    "in a counterclockwise circle | in an anticlockwise circle | "
    "in counterclockwise circles | in anticlockwise circles | in a circle counterclockwise | "
    "in a circle anticlockwise | "
    "counterclockwise in a circle | anticlockwise in a circle | in a counterclockwise direction | "
    "in an anticlockwise direction | "
    "counterclockwise in circles | anticlockwise in circles",
    "up": "up | upward | upwards | upstairs | straight up | up and down | into the air | in the air | high | "
    "up high | overhead",
    "down": "down | downward | downwards | downstairs | straight down | in a heap",
    "circle": "in a circle | in circles | around in a circle | around in circles | in a loop | a circle | "
    "along a circle",
}
"""Directions; a circle without its sense is read as a counterclockwise one, and said."""

GAITS = {
    "parkinsonian": "with the gait of Parkinson's disease | with the shuffling gait of Parkinson's | "
    "with a shuffling gait | with short shuffling steps | "
    "with small shuffling steps | with a parkinsonian gait | stooped and with short shuffling steps | "
    "as in Parkinson's disease",
    "festinating": "with a festinating gait | with short hurried steps, as if falling forward | "
    "with steps that grow shorter and faster | "
    "with festination | with ever shorter and faster steps | as if chasing {his} own balance",
    "freezing": "with freezing of gait | as if glued to the spot at times | with feet that seem stuck to the ground | "
    "with freezing episodes | "
    "with a freezing gait",
    "waddling": "with a waddling gait | like a duck | with a myopathic gait | rocking from side to side | "
    "with a Trendelenburg gait | "
    "with hips that drop at every step",
    "ataxic": "with an ataxic gait | as if drunk | with unsteady, wide-based steps | with a cerebellar gait | "
    "with an irregular, wide-based gait | swaying unsteadily",
    "scissor": "with a scissor gait | with a scissoring gait | with knees that cross at every step | "
    "with thighs that rub together | "
    "with a spastic scissor gait | with legs that cross like scissors",
    "steppage": "with a steppage gait | with a high-stepping gait | with a foot drop | with a drop foot | "
    "as if stepping over something at every step | with toes that drag, so that the knees go high",
    "limping": "with a limp | with an antalgic gait | with a limping gait | as if one side hurt | as if injured",
}
"""Kinds of abnormal gait in everyday and in clinical words, as the grammar writes them."""

MORE_GAITS = {
    "parkinsonian": "parkinson's | parkinsons | parkinson's disease | parkinsonian | parkinsonism | shuffling gait | "
    "shuffling steps | "
    "parkinson | gait of parkinson's | shuffling",
    "festinating": "festinating | festination | festinant | festinating gait | fixation",
    "freezing": "freezing of gait | freezing gait | freezing | but freezes again and again | freezes | "
    "gait freezing | stuck to the floor | glued to the floor | feet glued to the ground | "
    "glued to the ground | rooted to the spot | frozen gait",
    "waddling": "waddling | waddling gait | myopathic gait | trendelenburg gait | trendelenburg | like a penguin | "
    "from side to side like a duck | "
    "duck walk | dystrophic gait | swaying {his} hips from side to side",
    "ataxic": "ataxic | ataxic gait | ataxia | drunk | drunkenly | drunken | tipsy | intoxicated | unsteadily | "
    "unsteady | unsteady gait | dizzily | dizzy | "
    "staggering gait | wide-based gait | wide based gait | cerebellar gait | off balance | as if on a ship | "
    "like a drunk | "
    "in a drunken manner | wobbly | staggering",
    "scissor": "like scissors | scissors | scissor gait | scissoring | scissoring gait | scissors gait | "
    "spastic gait | diplegic gait | "
    "spastic diplegia | knees crossing | "
    "crossing {his} legs at every step | crossing {his} legs at each step | crossing {his} knees at every step | "
    "cerebral palsy | scissor",
    "steppage": "steppage | steppage gait | stepping gait | foot drop | drop foot | dropfoot | footdrop | "
    "high stepping | high-stepping | high stepping gait | "
    "neuropathic gait | foot slap | slapping {his} foot | slapping {his} feet | equine gait",
    "limping": "limping | limp | antalgic | antalgic gait | limping gait | hobbling | injured leg | hurt leg | "
    "sore leg | bad leg | injured knee | hurt knee | "
    "bad knee | uneven gait | hemiplegic gait | hemiparetic gait | lame | sprained ankle | injured foot | hurt foot | "
    "asymmetric gait | "
    "stiff leg | wounded leg",
}

FALLS = {
    "slip": "as if on ice | on a wet spot | on something wet | on a banana peel | on an icy path | on the ice | "
    "on ice | on a slippery spot | wet floor | icy floor | "
    "slippery floor | slippery",
    "trip": "over something | over a cable | over an edge | over {his} own feet | over an obstacle | on a cable | "
    "on a rug | over a rug",
    "collapse": "as if fainting | as if unconscious | with {his} legs giving way | after a dizzy spell | "
    "as if struck by a faint | unconscious | fainting | heart attack | "
    "as {his} legs give way | legs give way | legs give out | knees give way | stroke | dizzy spell | weakness",
}
"""What brings a fall about."""

_NEUTRAL = """
a an the this that these those of to in into on onto at for from with by as is are was were be been being it its his
her their he she they him them himself herself themselves themself own who which there while when before after
afterwards and then next finally again off out over across along around round about through toward towards near beside
behind between under above past or some each both one other can seen see has had have do does did so just also same
take takes taking took way place spot space side moment short few several little more very quite rather bit all
together every first last once seconds second minutes until shows video clip scene motion movement movements action
manner fashion style mood pace speed gait step steps walk body position up time times now if like gets starts start
starting begins begin beginning continues continue continuing keeps keeping makes making ends ending performs
performing within would could will shall may another direction end middle front against let lets land lands landing
landed too something somewhere object objects thing things feeling feels feel seems seem appears appear we us our
"""
NEUTRAL = frozenset(_NEUTRAL.split())
"""Words that fill no slot and are not reported."""

_OF_LIMBS = """
raised folded crossed clenched open heavy light tired stiff soft shaky trembling hanging dangling far pressed close
held apart extended bare tips pockets lap stick hardly painful help head wall
"""
OF_LIMBS = frozenset(_OF_LIMBS.split())
"""How a limb is, which its part of the body tells; beside none they are reported."""

ON_THE_SPOT = "on the spot | in place | on one spot | in one place"
"""Where jumps and turns go nowhere; of who walks or runs it is reported."""

FIXED = (
    "from sitting | from a seated position | from lying | from lying down | right away | right then | right now | all right | "
    "as far as | with {his} back to | after a moment | to {his} side | to the side of | next to | in front | in front of | "
    "at the start | to start with | steps forward in time | the next | on the way | by {his} side | by {his} sides | "
    "at {his} sides | at {his} side | under {his} head | of {him} | one of {his} | and lands | and then lands | lands again | "
    "standing position | sitting position | starting position | original position | both feet | both legs | two feet | two legs"
)
"""Phrases that fill no slot and are not reported, although they hold words that elsewhere do."""

REPORTED = (
    "{his} back hurts | hold {his} back | lower back | a straight back | {his} back straight | back pain | sore back | "
    "ball of {his} foot | balls of {his} feet | as high as possible | as far as possible | a few steps | small steps | "
    "short steps | long steps | large steps | big steps | even steps | "
    "head down | head up | {his} head | side by side | left and right arms | "
    "a step at a time | out of bed | at every step | "
    "two steps | three steps | four steps | five steps | "
    "two people | two persons | three people | two men | two women | two children | both people | "
    "back and forth | to and fro | forth and back | forward and backward | forwards and backwards | "
    "from side to side | side to side | from left to right | from right to left | sideways | "
    "backward and forward | backwards and forwards | back to | back into | in all directions"
)
"""Phrases that are reported as not understood as a whole."""

PHRASES_OF_TIME = {
    "then": "then | and then | after that | and after that | afterwards | and afterwards | after which | "
    "followed by | later | and finally | "
    "finally | next | subsequently | and next | before finally",
    "before": "before | prior to | until",
    "after": "after | having | once he has | once she has | once they have",
    "while": "while | whilst | when | during | as he | as she | as they | as the person | as the man | as the woman | "
    "as the child",
    "and": "and | but | or | so | and also",
    ",": ", | ; | : | . | ! | ? | ( | )",
}
"""What joins the steps of a sentence."""
