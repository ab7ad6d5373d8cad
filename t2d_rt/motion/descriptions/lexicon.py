"""Words for actions and for how they are done, by the slots that they fill; the grammar and the parser share them.

Each table maps slots ("walk speed=slow": an action and a slot) to words and phrases, divided by bars. The first word of a
verb's phrase is its infinitive; `{his}` stands for his, her, their, its or the. `~` stands for up to four words.
"""

from __future__ import annotations

VERBS = {
    "walk": "walk",
    "walk speed=slow": "stroll | amble | plod | trudge",
    "walk speed=fast": "hurry | stride briskly",
    "walk manner=careful": "tiptoe | creep",
    "walk manner=angry": "stomp",
    "walk manner=happy": "strut",
    "run": "run",
    "run speed=slow": "jog | trot",
    "run speed=fast": "sprint | race | dash",
    "turn": "turn | rotate | pivot",
    "climb": "climb",
    "stand": "stand still | stand upright | stand quietly",
    "sit": "sit down | take a seat",
    "stand_up": "stand up | get up | rise | get to {his} feet",
    "lie_down": "lie down | recline",
    "bend": "bend | stoop | bow",
    "squat": "squat | crouch | squat down | crouch down",
    "stretch": "stretch | do a stretch",
    "jump": "jump | leap | hop | spring",
    "dance": "dance | do a dance | waltz | sway to the music | twirl | perform a dance",
    "fall": "fall | topple",
    "fall type=slip": "slip and fall | slip and tumble | lose {his} footing and fall | skid and fall | slide and fall",
    "fall type=trip": "trip and fall | stumble and fall | trip and tumble",
    "fall type=collapse": "collapse | faint and fall | pass out and fall | black out and fall | crumple",
    "walk type=limping": "limp | hobble",
    "walk type=parkinsonian": "shuffle",
    "walk type=waddling": "waddle",
    "walk type=ataxic": "stagger | reel | lurch",
}
"""Verbs that the grammar writes."""

MORE_VERBS = {
    "walk": "march | pace | stride | wander | step | tread | roam | hike | prowl | take ~ step | take ~ steps | "
    "take a walk | "
    "go for a walk | saunter about | walk about | sidestep",
    "walk speed=slow": "saunter | dawdle | mosey | meander | take a stroll | go for a stroll | drag {his} feet",
    "walk speed=fast": "rush | hasten | power walk | speed walk",
    "walk manner=careful": "sneak | pussyfoot | tread carefully",
    "walk manner=angry": "storm",
    "walk manner=happy": "swagger",
    "run": "go for a run | gallop",
    "run speed=slow": "go for a jog",
    "run speed=fast": "bolt",
    "turn": "spin | swivel | revolve | do a turn | make a turn | veer | circle",
    "turn direction=back": "turn ~ around | rotate ~ around | pivot ~ around | turn 180 degrees | "
    "turn by 180 degrees | turn around | spin around | "
    "pivot around | rotate around | swivel around | turn round | turn back | about face | do a u turn | "
    "turn about",
    "climb": "ascend | clamber | mount",
    "climb direction=down": "descend",
    "stand": "stand | stop | halt | come to a stop | come to a halt | pause | wait | stand in place | "
    "remain standing | "
    "stay standing | keep standing | stand there",
    "sit": "sit | be seated | sit ~ down | sit on | take ~ seat | perch | settle down | have a seat | plop down | "
    "seat | flop down",
    "stand_up": "stand ~ up | get ~ up | rise ~ up | arise | get back up | stand back up | get out of | "
    "rise to {his} feet | "
    "come to {his} feet | "
    "struggle to {his} feet | get back to {his} feet | get on {his} feet | get back on {his} feet | "
    "jump to {his} feet | "
    "push ~ up | pick {his} self up | pick himself up | pick herself up | pick themselves up | pick themself up | "
    "stand again",
    "lie_down": "lie | lie ~ down | lay down | recline | lay on | lay {his} self down",
    "bend direction=down": "lean down | stoop down | reach down | reach ~ down | bow down",
    "bend": "lean over | stoop over | bend ~ over | lean ~ over | double over | "
    "hunch | crouch over | take a bow | touch {his} toes | scoop ~ up | pick ~ up | pick up | pick | gather | scoop | "
    "reach for the floor | reach for the ground | tie {his} shoe | tie {his} shoes | tie {his} shoelaces",
    "squat": "do a squat | do squats | perform a squat | perform squats | do ~ squats | kneel | kneel down | "
    "hunker down | get down on one knee | "
    "go down on one knee | drop into a squat | lower into a squat",
    "stretch": "stretch ~ out | do stretches | do some stretches | limber up",
    "jump": "bounce | skip | vault | hurdle | bound | do a jump | perform a jump | do ~ jumps | "
    "jump rope | "
    "leapfrog | take a leap | make a jump | star jump",
    "jump body_part=arm": "do jumping jacks | do ~ jumping jacks | do a jumping jack | perform ~ jumping jacks | jumping jack",
    "dance": "boogie | tango | salsa | jive | groove | pirouette | do the waltz | do ~ dance | perform ~ dance | "
    "do ballet | "
    "do a pirouette | breakdance | tap dance | dance along | move to the music | move to the beat | cha cha | "
    "do the twist",
    "fall": "tumble | keel over | go down hard | lose {his} balance | take a fall | take a tumble | "
    "have a fall | suffer a fall | crash to the floor | crash to the ground | drop to the floor | drop to the ground | "
    "hit the floor | hit the ground | land on the floor | land on the ground | go flying | end up on the floor | "
    "fall off",
    "fall type=slip": "slip | skid | slide | lose {his} footing | slip up | slip over",
    "fall type=trip": "trip | trip up | trip over | stumble over | catch {his} foot | catch {his} toe | "
    "catch a foot | catch a toe",
    "fall type=collapse": "faint | pass out | black out | keel over | swoon | lose consciousness | crumple | "
    "drop dead | "
    "buckle | sink to the floor | sink to the ground | slump | give way | suffer a seizure | have a seizure",
    "stumble": "stumble",
    "walk type=limping": "favour {his} ~ leg | favor {his} ~ leg | drag {his} ~ leg | drag one leg | drag a leg | "
    "drag {his} ~ foot",
    "walk type=freezing": "freeze",
    "walk type=festinating": "festinate",
    "walk type=ataxic": "totter | teeter | weave | wobble",
    "walk type=scissor": "scissor walk",
    "walk type=steppage": "high step",
    "weak walk": "move | go | advance | proceed | travel | head | approach | come | return",
    "weak bend": "lean | tilt",
}
"""Verbs that only the parser knows; a weak one counts where no other verb tells an action, or with a direction."""

PARTLY = (
    "tiptoe | sidestep | march | gallop | skip | vault | hurdle | leapfrog | jump rope | star jump | kneel | kneel down | "
    "get down on one knee | go down on one knee | waltz | do the waltz | tango | salsa | jive | boogie | breakdance | tap dance | "
    "cha cha | pirouette | do a pirouette | do ballet | do the twist | twirl | hike | tie {his} shoe | tie {his} shoes | "
    "tie {his} shoelaces | suffer a seizure | have a seizure | crawl | fall off"
)
"""Verbs of the tables above that say more than is made of them: who waltzes dances, but no waltz. That is told."""

ATTENDING = (
    "swing | raise | lift | hold | carry | keep | rest | "
    " use | have | grip | grasp | lift up | hold on | hold out | let | touch | "
    "support | balance | bring | draw | drag | pump | cross | brush | tremble | sway | trail | wear | spread | set | "
    "tuck | steady | spare | tap | fold | clench | press"
)
"""Verbs of a limb that takes part in what another verb says: they begin no step."""

ATTENDING_PARTS = {
    "body_part=hand": "clap {his} hands | place {his} hands | place {his} hand | put {his} hands | put {his} hand | "
    "move {his} hands | clap | "
    "wave {his} hands | wave {his} hand",
    "body_part=arm": "move {his} arms | wave {his} arms | bend {his} arms | flail {his} arms | bend {his} elbows",
    "body_part=leg": "kick {his} legs | kick {his} leg | bend {his} legs",
    "body_part=knee": "bend {his} knees | bend {his} knee",
    "body_part=waist": "swing {his} hips | roll {his} hips | shake {his} hips | sway {his} hips",
}
"""Verbs of certain limbs."""

RECOVERING = (
    "regain {his} balance | regain balance | recover | recover {his} balance | keep {his} balance | catch himself | "
    "catch herself | catch themself | catch themselves | steady himself | steady herself | stay upright | "
    "stay on {his} feet"
)
"""What says that somebody does not fall."""

OTHER_ACTIONS = (
    "kick | punch | throw | point | wave | crawl | swim | catch | slap | push | pull | drink | eat | write | wash | "
    "brush {his} teeth | "
    "pick up {his} arms | pick up {his} arm | pick up {his} hands | pick up {his} hand | pick up {his} leg | "
    "pick up {his} foot | "
    "place | put | poke | box | fight | cartwheel | roll | look | talk | drop | clasp | shrug | nod | juggle | "
    "dribble | "
    "open | close | drive | ride | cook | read | type | shake {his} head | salute | lunge | somersault | backflip | "
    "play | shoot | "
    "squeeze | knock | stir | paint | hug | bat | sweep | mop | vacuum | lie about | fall asleep | fall in love"
)
"""Other things that people do: what is said of them is reported as not understood, and fills no slot."""

ADVERBS = {
    "speed=slow": "slowly | unhurriedly",
    "speed=fast": "quickly | fast | rapidly | hurriedly",
    "speed=normal": "at a normal pace | at a normal speed | at an ordinary pace",
    "manner=careful": "carefully | cautiously | gingerly",
    "manner=happy": "happily | cheerfully | merrily",
    "manner=angry": "angrily | furiously",
    "manner=sad": "sadly | gloomily | sorrowfully",
}
"""Adverbs that the grammar writes."""

PHRASES = {
    "speed=slow": "at a slow pace | in no hurry | with slow movements | as if in no hurry | as if very tired | "
    "without hurrying | in a slow way",
    "speed=fast": "at a quick pace | in a hurry | with quick movements | at a fast pace | as if in a great hurry | "
    "in a quick way | as if late",
    "manner=careful": "with great care | in a careful way | as if afraid to fall | with caution",
    "manner=happy": "in a happy mood | with joy | as if full of joy | in high spirits",
    "manner=angry": "in an angry mood | with anger | as if angry | in a rage",
    "manner=sad": "in a sad mood | with sadness | as if very sad | in low spirits",
}
"""Prepositional phrases and clauses of the same meaning."""

ADJECTIVES = {
    "speed=slow": "slow",
    "speed=fast": "quick | fast",
    "manner=careful": "careful | cautious",
    "manner=happy": "happy | cheerful",
    "manner=angry": "angry | furious",
    "manner=sad": "sad | unhappy",
}
"""Adjectives of who moves."""

MORE_MODIFIERS = {
    "speed=slow": "sluggishly | leisurely | at a leisurely pace | at a snail's pace | gradually | lazily | sluggish | "
    "with slow steps | slow motion | in slow motion | wearily | tiredly | at slow speed | very slowly | calmly | "
    "in a slow pace | gently | slower",
    "speed=fast": "speedily | swiftly | briskly | hastily | in haste | at full speed | at top speed | "
    "as fast as possible | rushed | swift | "
    "rapid | brisk | with quick steps | at high speed | at a brisk pace | abruptly | energetically | in a rush | "
    "hurried | faster | quicker",
    "speed=normal": "at normal speed | normally | at a regular pace | at a moderate pace | at a steady pace | "
    "with a normal gait",
    "manner=careful": "warily | with care | as if afraid of falling | timidly | tentatively | wary | gingerly | "
    "quietly | sneakily | "
    "stealthily | hesitantly | watchfully | safely",
    "manner=happy": "gladly | joyfully | joyful | joyously | gleefully | glad | merry | excitedly | excited | "
    "in a good mood | jauntily | "
    "happiness | in a cheerful way | playfully | with excitement",
    "manner=angry": "irritably | mad | with rage | in anger | in fury | aggressively | annoyed | irritated | "
    "enraged | crossly | in a bad mood | aggressive",
    "manner=sad": "unhappily | mournfully | dejectedly | depressed | dejected | sorrowful | gloomy | in sorrow | "
    "melancholy | sorrowing | "
    "glumly | crying | tearfully | in tears | downcast",
}
"""Words for manner and speed that only the parser knows."""

NOT = (
    "not | n't | never | without | avoid | avoids | avoiding | avoided | almost | nearly | barely avoids | "
    "instead of | rather than | "
    "refuse to | refuses to | tries to | tried to | trying to | try to | fails to | failed to | about to | "
    "pretends to | no | nobody | none"
)
"""Words that say that what follows does not happen, or only nearly."""
