"""Targets that go through walls and furniture: found when and where it happens, and nothing else found."""

from __future__ import annotations

import tracemalloc
import warnings
from dataclasses import replace

import numpy as np
import pytest

import builders
import t2d_rt as t2d
from builders import ball, plate, slow_after
from t2d_rt.core.backend import Backend
from t2d_rt.core.errors import InputError, T2DWarning
from t2d_rt.motion import aside
from t2d_rt.pipeline.targets import targets_of
from t2d_rt.propagation.collisions import Collision, Held, find_collisions, is_room, radar_outside, uneven_times
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.propagation.scenes import load_scene, scene_names
from t2d_rt.scene import CeilingFan, Curtain, Door, Mover, Room, TableFan
from t2d_rt.types import CANONICAL_JOINTS, Ellipsoids, Motion, MovingMesh, Radar, Scene

RADAR = Radar.preset("table2")
ROOM = Room(name="cell", size_m=(5, 4, 2.5))
"""From (-0.5, -2) to (4.5, 2)."""


@pytest.fixture(scope="module")
def walk() -> Motion:
    return t2d.place(builders.walk(), distance_m=4.3)


def found(backend: Backend, scene: Scene, target: Motion | MovingMesh | Ellipsoids) -> list[Collision]:
    return find_collisions(scene, [target], RADAR, float(target.times_s[0]), float(target.times_s[-1]), backend=backend)


def with_wall(x: float) -> Scene:
    """The room with one more wall across."""
    wall = plate("partition", [(x, -2, 0), (x, 2, 0), (x, 2, 2.5), (x, -2, 2.5)], "plasterboard", 0.0125)
    return replace(ROOM.scene(), surfaces=(*ROOM.scene().surfaces, wall))


# --- where and when ---


def test_a_walk_through_a_wall_is_found_in_each_form(backend: Backend, walk: Motion) -> None:
    pelvis = walk.joints[:, 0]
    frame = int(np.argmax(pelvis[:, 0] < 3.0))
    for form in (walk, t2d.skin(walk), t2d.segments(walk)):
        (collision,) = found(backend, with_wall(3.0), form)
        assert collision.surface == "partition"
        # Of a mesh and of ellipsoids a foot or a hand goes first.
        ahead_s, ahead_m = (0.1, 0.2) if isinstance(form, Motion) else (0.4, 1.0)
        assert abs(collision.time_s - walk.times_s[frame]) < ahead_s
        assert np.linalg.norm(collision.place_m[:2] - pelvis[frame, :2]) < ahead_m
        assert abs(collision.place_m[0] - 3.0) < 1e-3


def test_a_walk_inside_is_left_alone(backend: Backend, walk: Motion) -> None:
    for form in (walk, t2d.skin(walk), t2d.segments(walk)):
        assert found(backend, ROOM.scene(), form) == []


@pytest.mark.parametrize(("scene", "inside"), [("living_room", True), ("corridor", True), ("bedroom", False)])
def test_the_walk_where_it_is_placed_by_itself(backend: Backend, scene: str, inside: bool) -> None:
    """It starts 5.5 m ahead: in the living room and in the corridor there is room for that, the bedroom ends at 4.5 m."""
    motion = t2d.place(builders.walk())
    collisions = found(backend, load_scene(scene), motion)
    assert [each.surface for each in collisions] == ([] if inside else [None])


def test_furniture_too_low_for_the_pelvis_is_furniture(backend: Backend, walk: Motion) -> None:
    room = Room(name="cell", size_m=(5, 4, 2.5), furniture=({"kind": "coffee_table", "x_m": 2.5, "y_m": 0},))
    (collision,) = found(backend, room.scene(), walk)
    assert str(collision.surface).startswith("coffee_table")
    assert np.linalg.norm(collision.place_m[:2] - [2.5, 0]) < 0.7


@pytest.mark.parametrize(("height_m", "surface"), [(0.06, []), (-0.2, ["floor"])])
def test_feet_may_dip_into_the_floor(backend: Backend, height_m: float, surface: list[str]) -> None:
    """A sphere of 10 cm, whose lowest part's middle lies 9 cm under its own."""
    sinking = ball((2.0, 0.0, 0.3), (0, 0, height_m - 0.3), 1.0, level=2)
    assert [each.surface for each in found(backend, ROOM.scene(), sinking)] == surface


def sitting_down(seat_m: tuple[float, float, float]) -> Motion:
    """In two seconds, towards +x; thighs and shins of 42 cm."""
    bend = np.pi / 2 * np.clip(np.linspace(-0.2, 1.2, 60), 0, 1)
    seat, zero = np.array(seat_m), np.zeros(60)
    ankle = np.broadcast_to([seat[0] + 0.42, seat[1], 0.08], (60, 3))
    knee = ankle + [0, 0, 0.42]
    pelvis = knee + 0.42 * np.stack([-np.sin(bend), zero, np.cos(bend)], axis=1)
    pelvis[:, 2] = np.maximum(pelvis[:, 2], seat[2])
    trunk = np.stack([0.25 * np.sin(2 * bend), zero, zero + 0.4], axis=1)
    place = {"knee": knee, "ankle": ankle, "foot": ankle, "spine3": pelvis + trunk, "head": pelvis + 1.5 * trunk}
    joints = np.stack([place.get(name.split("_")[-1], pelvis) for name in CANONICAL_JOINTS], axis=1)
    return Motion(joints=joints, rotations=np.tile([0.0, 0, 0, 1], (60, 22, 1)), rate_hz=30.0)


@pytest.mark.parametrize(("kind", "forward_m"), [("chair", 0.0), ("armchair", 0.1), ("sofa", 0.1), ("bed", 0.7)])
def test_one_may_sit_down(backend: Backend, kind: str, forward_m: float) -> None:
    room = Room(name="cell", size_m=(5, 4, 2.5), furniture=({"kind": kind, "x_m": 2.0, "y_m": 0},))
    assert found(backend, room.scene(), sitting_down((2.0 + forward_m, 0.0, 0.52))) == []


# --- what people carry ---


def told_of(backend: Backend, scene: Scene, motion: Motion) -> list[tuple[str, str | None]]:
    """Names of who and what goes through what, of a person and the things that they carry."""
    targets = targets_of([motion], "mesh", "adult", None, RADAR)
    time_s = float(motion.times_s[0]), float(motion.times_s[-1])
    collisions = find_collisions(scene, [target.tested for target in targets], RADAR, *time_s, backend=backend)
    return [(targets[each.target].world.name, each.surface) for each in collisions]


@pytest.mark.parametrize(("aside_m", "told"), [(1.4, []), (1.7, [("bag", "wall+y")])])
def test_a_bag_that_is_in_the_wall_all_the_way_is_found(
    backend: Backend, walk: Motion, aside_m: float, told: list[tuple[str, str]]
) -> None:
    """It hangs 19 to 43 cm beside the middle of the body, the wall is at 2 m."""
    carrying = t2d.carry(walk, "bag")
    assert told_of(backend, ROOM.scene(), aside(carrying, aside_m)) == told


@pytest.mark.parametrize(("behind_m", "told"), [(0.24, [("backpack", "back of a chair")]), (0.5, [])])
def test_a_backpack_with_the_back_of_a_chair_in_it_is_found(
    backend: Backend, walk: Motion, behind_m: float, told: list[tuple[str, str]]
) -> None:
    """Nothing moves: the pack lies 0.14 to 0.32 m behind the upper spine of somebody who faces the radar."""
    still = replace(
        walk, joints=np.repeat(walk.joints[60:61], 60, axis=0), rotations=np.repeat(walk.rotations[60:61], 60, axis=0)
    )
    x, y, z = still.joints[0, still.index("spine3")]
    corners = [(x + behind_m, y + across, z + up) for across, up in ((-0.2, -0.4), (0.2, -0.4), (0.2, 0), (-0.2, 0))]
    scene = replace(ROOM.scene(), surfaces=(*ROOM.scene().surfaces, plate("back of a chair", corners, "wood", 0.02)))
    assert told_of(backend, scene, t2d.carry(still, "backpack")) == told


def test_a_wheelchair_may_stand_on_the_floor_and_its_user_at_a_table(backend: Backend, walk: Motion) -> None:
    rolling = t2d.carry(t2d.place(walk, distance_m=4.1), "wheelchair")
    x, y, _ = rolling.joints[-1, rolling.index("pelvis")]
    corners = [(x - 0.9, y - 0.5, 0.74), (x - 0.2, y - 0.5, 0.74), (x - 0.2, y + 0.5, 0.74), (x - 0.9, y + 0.5, 0.74)]
    table = plate("table", corners, "wood", 0.03)
    assert told_of(backend, replace(ROOM.scene(), surfaces=(*ROOM.scene().surfaces, table)), rolling) == []


def test_a_carried_thing_is_posed_at_some_instants_at_once(backend: Backend, walk: Motion) -> None:
    """Memory does not grow with the record: the test takes less than the vertices at all instants alone would."""
    standing = replace(
        walk, joints=np.repeat(walk.joints[:1], 3001, axis=0), rotations=np.repeat(walk.rotations[:1], 3001, axis=0), rate_hz=100.0
    )  # fmt: skip
    frame = targets_of([t2d.carry(standing, "walker")], "mesh", "adult", None, RADAR)[1].tested
    assert isinstance(frame, Held)
    find_collisions(ROOM.scene(), [frame], RADAR, 0.0, 1.0, backend=backend)
    tracemalloc.start()
    assert find_collisions(ROOM.scene(), [frame], RADAR, 0.0, 30.0, backend=backend) == []
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most_bytes < frame.mesh.rest.nbytes * len(uneven_times(0.0, 30.0))


# --- movers ---

DOORWAY = {"name": "doorway", "wall": "-y", "along_m": 0.0, "width_m": 0.8, "height_m": 2.0}


@pytest.mark.parametrize("slab", slow_after(1, [None, {"material": "wood", "thickness_m": 0.04}]))
def test_movers_near_their_wall_cry_no_wolf(backend: Backend, slab: object) -> None:
    """A door that swings in its frame, open or drawn closed, a curtain before a wall, fans in the free."""
    room = Room(name="cell", size_m=(5, 4, 2.5), openings=({**DOORWAY, "slab": slab},))
    movers: list[Mover] = [
        Door(position_m=(1.6, -2.0, 0.0), heading_deg=0),
        Curtain(position_m=(4.45, 0.0, 2.3)),
        TableFan(position_m=(3.0, 1.0, 1.0)),
        CeilingFan(position_m=(2.0, 0.0, 2.3)),
    ]
    for mover in movers:
        assert found(backend, room.scene(), mover.mesh(0, 6)) == [], mover.noun


@pytest.mark.parametrize(
    "mover",
    [
        TableFan(position_m=(3.0, 1.95, 1.0), radius_m=0.25, heading_deg=180),
        TableFan(position_m=(3.0, 1.95, 1.0), radius_m=0.25, heading_deg=180, rpm=1500),
        CeilingFan(position_m=(2.0, 1.7, 2.3)),
    ],
)
def test_a_fan_that_cuts_into_a_wall_is_found(backend: Backend, mover: Mover) -> None:
    (collision,) = found(backend, ROOM.scene(), mover.mesh(0, 4))
    assert collision.surface == "wall+y"


def test_instants_are_uneven_and_in_order() -> None:
    """In even ones what turns as often as they are would stand still."""
    times = uneven_times(1.0, 5.0)
    assert (times[0], times[-1]) == (1.0, 5.0)
    steps = np.diff(times)
    assert 0 < steps.min() < 0.8 * steps.max()
    assert steps.max() < 2 / 25


# --- what simulate makes of it ---


def test_simulate_warns_of_what_where_and_when() -> None:
    """The sphere's middle is in the wall after 0.25 s; its front is 4.5 cm ahead."""
    through = ball((4.0, 0.5, 1.2), (2.0, 0.0, 0.0), 0.4, level=2)
    with pytest.warns(
        T2DWarning,
        match=r"ball goes through wall\+x of cell at 0\.2[0-5] s, at \(4\.50, 0\.[45]\d, 1\.[12]\d\) m; place it elsewhere, choose",
    ):
        t2d.simulate(through, scene=ROOM, reflections=0, clutter="none")


def test_simulate_stops_before() -> None:
    through = ball((4.0, 0.5, 1.2), (2.0, 0.0, 0.0), 0.4, level=2)
    options = {"scene": ROOM, "reflections": 0, "clutter": "none"}
    stopped = t2d.simulate(through, **options, collisions="stop")
    lasted = stopped.cube.shape[0] / RADAR.prf_hz
    assert 0.15 < lasted < 0.25
    assert stopped.settings["collisions"] == "stop"
    # Up to there it is the same record: the frames lie elsewhere, so to the model's accuracy.
    whole = t2d.simulate(through, **options, collisions="ignore")
    first = whole.adc.values[: stopped.cube.shape[0] - 100]
    same = stopped.adc.values[: len(first)]
    assert np.sum(np.abs(same - first) ** 2) < 1e-3 * np.sum(np.abs(first) ** 2)


@pytest.mark.slow
def test_nothing_is_said_of_what_comes_after_the_stop() -> None:
    leaving = ball((3.0, 0.0, 1.0), (9.0, 0.0, 0.0), 3.0, level=2)
    options = {"radar": RADAR, "scene": ROOM, "reflections": 0, "clutter": "none"}
    with warnings.catch_warnings():
        warnings.simplefilter("error", T2DWarning)
        stopped = t2d.simulate(leaving, **options, collisions="stop")
    assert stopped.cube.shape[0] / RADAR.prf_hz < 0.2
    with pytest.warns(T2DWarning, match="beyond the unambiguous"):
        t2d.simulate(leaving, **options, collisions="ignore")


@pytest.mark.slow
def test_nothing_is_said_of_what_stays_inside() -> None:
    inside = ball((3.0, 0.5, 1.2), (2.0, 0.0, 0.0), 0.1, level=2)
    with warnings.catch_warnings():
        warnings.simplefilter("error", T2DWarning)
        chirps = [
            len(t2d.simulate(inside, scene=ROOM, reflections=0, clutter="none", collisions=collisions).cube)
            for collisions in ("warn", "stop", "ignore")
        ]
    assert chirps == [chirps[2]] * 3


@pytest.mark.slow
def test_what_starts_outside_is_told() -> None:
    """It is seen through an open window."""
    room = Room(
        name="cell",
        size_m=(5, 4, 2.5),
        openings=({"name": "window", "wall": "+x", "width_m": 2, "height_m": 1.5, "sill_m": 0.5},),
    )
    outside = ball((5.2, 0.2, 1.2), (0.0, 0.3, 0.0), 0.2, level=2)
    message = r"ball starts at \(5\.20, 0\.20, 1\.20\) m, outside cell, which reaches from \(-0\.5, -2, 0\) to \(4\.5, 2, 2\.5\) m"
    with pytest.warns(T2DWarning, match=message):
        t2d.simulate(outside, scene=room, reflections=0, clutter="none")
    with pytest.raises(InputError, match=message + ", which leaves no record to stop at"):
        t2d.simulate(outside, scene=room, reflections=0, clutter="none", collisions="stop")
    with warnings.catch_warnings():
        warnings.simplefilter("error", T2DWarning)
        t2d.simulate(outside, scene=room, reflections=0, clutter="none", transmissions=2)


def test_of_several_targets_the_one_is_told() -> None:
    targets = [
        ball((3.0, -0.5, 1.2), (0.1, 0, 0), 0.4, level=2),
        ball((4.0, 0.5, 1.2), (2.0, 0.0, 0.0), 0.4, level=2),
    ]
    with pytest.warns(T2DWarning, match=r"ball \(target 2 of 2\) goes through wall\+x") as told:
        t2d.simulate(targets, scene=ROOM, reflections=0, clutter="none")
    assert len(told) == 1


def test_what_may_become_of_collisions() -> None:
    with pytest.raises(InputError, match="collisions must be 'warn', 'stop' or 'ignore', got 'bounce'"):
        t2d.simulate(ball((3, 0, 1), time_s=0.1, level=2), scene=ROOM, collisions="bounce")  # type: ignore[arg-type]


# --- a radar outside ---


def away(x: float, y: float = 0.0) -> Radar:
    return RADAR.model_copy(update={"position_m": (x, y, 1.0)})


OPEN = Room(name="cell", size_m=(5, 4, 2.5), openings=({"name": "gap", "wall": "-x", "width_m": 3, "height_m": 2.4},))
"""The wall behind the radar is nearly all open."""


@pytest.mark.slow
def test_radar_and_target_outside_are_told() -> None:
    """Both on the same side of the room: nothing stands between them, and no line goes through anything."""
    told = r"the radar is at \(-3\.00, 0\.00, 1\.00\) m, outside cell, which reaches from .* to \(4\.5, 2, 2\.5\) m; move it"
    outside = ball((-1.5, 0.2, 1.2), (0.0, 0.3, 0.0), 0.2, level=2)
    options = {"radar": away(-3.0), "scene": ROOM, "reflections": 0, "clutter": "none"}
    with (
        pytest.warns(T2DWarning, match=r"ball starts at \(-1\.\d\d, 0\.20, 1\.20\) m, outside cell"),
        pytest.warns(T2DWarning, match=told),
    ):
        t2d.simulate(outside, **options)
    with pytest.raises(InputError, match=told):
        t2d.simulate(outside, **options, collisions="stop")
    with warnings.catch_warnings():
        warnings.simplefilter("error", T2DWarning)
        t2d.simulate(outside, **options, collisions="ignore")
        t2d.simulate(outside, **options, transmissions=1)


def test_a_radar_outside_that_faces_the_room_is_told() -> None:
    inside = ball((2.0, 0.2, 1.2), (0.0, 0.3, 0.0), 0.2, level=2)
    options = {"radar": away(-3.0), "scene": OPEN, "reflections": 0, "clutter": "none"}
    with pytest.warns(T2DWarning, match=r"the radar is at .* outside cell") as told:
        t2d.simulate(inside, **options)
    assert len(told) == 1


FLOOR = plate("floor", [(0, -2, 0), (4, -2, 0), (4, 2, 0), (0, 2, 0)])
BACK = plate("back", [(4, -2, 0), (4, 2, 0), (4, 2, 3), (4, -2, 3)])
SIDE = plate("side", [(0, 2, 0), (4, 2, 0), (4, 2, 3), (0, 2, 3)])


@pytest.mark.parametrize(
    ("scene", "room"),
    [
        (ROOM.scene(), True), (OPEN.scene(), True),
        (Scene(name="no ceiling", surfaces=tuple(s for s in ROOM.scene().surfaces if s.name != "ceiling")), True),
        (Scene(name="wall", surfaces=(BACK,)), False), (Scene(name="corner", surfaces=(FLOOR, BACK)), False),
        (Scene(name="half", surfaces=(FLOOR, BACK, SIDE)), False),
        (Scene(name="box", surfaces=tuple(replace(s, vertices=s.vertices * 0.25) for s in ROOM.scene().surfaces)), False),
    ],
)  # fmt: skip
def test_what_is_a_room(backend: Backend, scene: Scene, room: bool) -> None:
    """Only a room has an outside where a radar has no business."""
    assert is_room(Mirrors.of(scene, backend)) is room
    assert (radar_outside(scene, away(-3.0), (0.0, 1.0), backend) is not None) is room
    assert radar_outside(scene, away(0.5), (0.0, 1.0), backend) is None


@pytest.mark.parametrize("name", scene_names())
def test_shipped_scenes_are_rooms(backend: Backend, name: str) -> None:
    mirrors = Mirrors.of(load_scene(name), backend)
    assert is_room(mirrors)
    assert radar_outside(mirrors.scene, RADAR, (0.0, 1.0), backend) is None
