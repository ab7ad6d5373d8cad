"""Movers: what they are as meshes, how they move, what the radar sees of a fan, and how they are written down."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.special import jn_zeros

import t2d_rt as t2d
from builders import slow_after
from t2d_rt.core.errors import InputError
from t2d_rt.pipeline.echo_model import farthest_and_fastest
from t2d_rt.scene import Mover, mover
from t2d_rt.types import Ellipsoids, MovingMesh, Radar
from validation.physics.movers import seen

ENTRIES = (
    "fan:2,1,1.2,rpm=600,swing_deg=80,elevation_deg=10", "ceiling_fan:2,1,2.3,radius_m=0.3", "curtain:3,0,2.2",
    "door:3,-0.4,0,opens_at_s=0", "pet:3,0,0", "pet:3,0,0,animal=cat,speed_mps=1,turn_radius_m=0.5",
    "pet:3,0,0,speed_mps=1.5,turn_radius_m=none,size=1.2",
)  # fmt: skip
QUICK = Radar.preset("table2", samples=16, prf_hz=4_000.0)


def known(entry: str, **changes: Any) -> Any:
    """The mover of an entry, with other values for some fields."""
    return type(mover(entry))(**{**mover(entry).model_dump(), **changes})


# --- meshes and tracks ---


@pytest.mark.parametrize("entry", ENTRIES)
def test_closed_skins_that_face_outward(entry: str) -> None:
    mesh = mover(entry).mesh(0.0, 5.0)  # warns, which fails, where it is not watertight; refuses what is inside out
    for time_s in (0.0, 1.3, 4.9):
        solid = mesh.trimesh(time_s)
        assert solid.is_watertight
        assert solid.is_winding_consistent
        assert all(part.volume > 0 for part in solid.split())
        assert solid.area_faces.min() > 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("entry", ENTRIES)
def test_accelerations_have_no_jumps(entry: str) -> None:
    mesh = mover(entry).mesh(0.0, 2.0)

    def largest_jump(step_s: float) -> float:
        """Between accelerations one step apart: of the step's order, unless the track is not C2."""
        vertices = mesh.at(np.arange(0, 1, step_s))
        return float(np.abs(np.diff(vertices, n=3, axis=0)).max() / step_s**2)

    assert largest_jump(1e-3) < 0.6 * largest_jump(2e-3)


def test_the_same_seed_gives_the_same_curtain() -> None:
    times = np.linspace(0, 2, 5)
    first, again, other = (known("curtain:3,0,2.2", seed=seed).mesh(0, 2).at(times) for seed in (1, 1, 2))
    assert (first == again).all()
    assert np.abs(first - other).max() > 0.02


def test_a_curtain_hangs_from_its_rail() -> None:
    curtain = known("curtain:3,0,2.2", draught_m=0.1)
    times = np.linspace(0, 40, 801)
    vertices = curtain.mesh(0, 40).at(times)
    height = vertices[0, :, 2]
    rail, hem = height > 2.2 - 1e-9, height < 1e-9
    assert np.ptp(vertices[:, rail], axis=0).max() == 0
    swing = vertices[:, hem][:, 0, 0] - vertices[:, hem][:, 0, 0].mean()
    spectrum = np.abs(np.fft.rfft(swing * np.hanning(len(times))))
    slowest = jn_zeros(0, 1)[0] / 2 * math.sqrt(9.80665 / 2.2) / (2 * math.pi)  # of a hanging chain
    assert np.fft.rfftfreq(len(times), 0.05)[spectrum.argmax()] == pytest.approx(slowest, abs=0.02)
    assert 2 * spectrum.max() / np.hanning(len(times)).sum() == pytest.approx(0.1, rel=0.1)


def test_a_door_rotates_about_its_hinges() -> None:
    door = known(
        "door:3,-0.4,0", opens_at_s=0.5, opening_s=1.5, period_s=5, angle_deg=80, width_m=0.8, thickness_m=0.04
    )
    times = np.linspace(0, 10, 10_001)
    vertices = door.mesh(0, 10).at(times)
    from_hinge = np.linalg.norm(vertices[..., :2] - [3, -0.4], axis=2)
    assert np.ptp(from_hinge, axis=0).max() < 1e-12
    assert from_hinge[0].min() == pytest.approx(0.02)  # half of its thickness
    edge = int(from_hinge[0].argmax())
    speed = np.linalg.norm(np.gradient(vertices[:, edge], times, axis=0), axis=1)
    assert speed.max() == pytest.approx(15 / 8 * from_hinge[0].max() * math.radians(80) / 1.5, rel=1e-5)
    shut = door.opening(np.array([0.0, 0.5, 4.5, 5.5, 9.9]))
    assert shut == pytest.approx([0, 0, 0, 0, 0], abs=1e-12)
    assert door.opening(np.array([2.0, 3.0, 7.5])) == pytest.approx([1, 1, 1])
    assert known("door:3,0,0", period_s=None).opening(np.array([1e3])) == 1


# --- a fan before the radar ---


@pytest.mark.parametrize(
    ("blades", "rpm", "radius_m"), slow_after(1, [(3, 600.0, 0.18), (2, 900.0, 0.15), (4, 1200.0, 0.12)])
)
def test_flashes_and_tips_of_a_fan(blades: int, rpm: float, radius_m: float) -> None:
    flash_hz, tip_mps = seen(blades, rpm, radius_m)
    assert flash_hz == pytest.approx(blades * rpm / 60, rel=0.02)
    assert tip_mps == pytest.approx(2 * math.pi * rpm / 60 * radius_m, rel=0.02)


@pytest.mark.parametrize(("entry", "axis"), [("fan:0,0,0,heading_deg=0", (1, 0, 0)), ("ceiling_fan:0,0,0", (0, 0, -1))])
def test_blades_push_the_air_ahead(entry: str, axis: tuple[int, int, int]) -> None:
    mesh = mover(entry).mesh(0, 1)
    before, after = mesh.at(np.array([0.0, 1e-4]))
    corners = before[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    along = normal @ axis
    moved = np.einsum("fi,fi->f", normal, (after - before)[mesh.faces].mean(axis=1))
    # Faces that look ahead advance along their normals, all but narrow rims; those behind draw back.
    for side, sign in ((along > 0, 1), (along < 0, -1)):
        assert sign * moved[side].sum() > 0.9 * np.abs(moved[side]).sum()
    radius = np.linalg.norm(np.cross(before, axis), axis=1)
    assert radius.max() == pytest.approx(mover(entry).radius_m, rel=1e-9)


# --- gait ---

TOUCHDOWN = {"left hind": 0.0, "left fore": 0.25, "right hind": 0.5, "right fore": 0.75}


def paws(pet: t2d.Pet, times_s: np.ndarray) -> dict[str, np.ndarray]:
    """The four parts that reach lowest, (K, vertices, 3), by where they are."""
    mesh = pet.mesh(times_s[0], times_s[-1])
    vertices, edges = mesh.at(times_s), mesh.faces[:, [0, 1]]
    size = len(mesh.rest)
    count, part = connected_components(coo_array((np.ones(len(edges)), edges.T), shape=(size, size)), directed=False)
    low = sorted(range(count), key=lambda number: vertices[:, part == number, 2].min())[:4]
    found = {}
    trunk = vertices[:, part == 0].mean(axis=1)
    for number in low:
        offset = vertices[:, part == number].mean(axis=1) - trunk
        heading = math.radians(pet.heading_deg) + np.zeros(len(times_s))
        if pet.turn_radius_m is not None:
            heading += pet.speed_mps * times_s / pet.turn_radius_m
        ahead = np.mean(offset[:, 0] * np.cos(heading) + offset[:, 1] * np.sin(heading))
        aside = np.mean(offset[:, 1] * np.cos(heading) - offset[:, 0] * np.sin(heading))
        found[f"{'left' if aside > 0 else 'right'} {'fore' if ahead > 0 else 'hind'}"] = vertices[:, part == number]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("entry", [entry for entry in ENTRIES if entry.startswith("pet")])
def test_paws_rest_in_lateral_sequence(entry: str) -> None:
    pet = mover(entry)
    assert isinstance(pet, t2d.Pet)
    strides, steps = 6, 400
    times = np.arange(strides * steps + 1) / (steps * pet.stride_hz)
    found = paws(pet, times)
    assert found.keys() == TOUCHDOWN.keys()
    for name, vertices in found.items():
        moved = np.abs(np.diff(vertices, axis=0)).max(axis=(1, 2)) / pet.speed_mps / times[1]
        stands = moved < 1e-9
        assert stands.mean() == pytest.approx(0.65, abs=0.01)
        assert vertices[..., 2].min() == pytest.approx(0, abs=1e-9)
        assert vertices[1:][stands][..., 2].min(axis=1) == pytest.approx(0, abs=1e-9)
        touchdown = np.flatnonzero(stands[1:] & ~stands[:-1]) / steps
        assert len(touchdown) in (strides - 1, strides)
        late = touchdown - TOUCHDOWN[name]
        assert late - np.round(late) == pytest.approx(np.zeros(len(late)), abs=0.02)
        if pet.turn_radius_m is None:
            assert np.linalg.norm(vertices[-1] - vertices[0], axis=1) == pytest.approx(strides * pet.stride_m)


def test_strides_follow_alexander() -> None:
    dog = known("pet:3,0,0", speed_mps=1.0)
    assert dog.stride_m / dog.hip_m == pytest.approx(2.3 * (1 / (9.80665 * 0.5)) ** 0.3)
    assert dog.stride_m * dog.stride_hz == pytest.approx(1.0)
    # Dynamically similar animals: a larger one at the same Froude number takes a proportionally longer stride.
    larger = known("pet:3,0,0", size=2.0, speed_mps=math.sqrt(2), turn_radius_m=None)
    assert larger.stride_m == pytest.approx(2 * dog.stride_m)


def test_a_dog_comes_round() -> None:
    dog = known("pet:3,1,0", turn_radius_m=1.0, speed_mps=1.0, heading_deg=90)
    middle = dog.mesh(0, 2 * math.pi).at(np.array([0.0, math.pi])).mean(axis=1)
    assert middle[0, :2] == pytest.approx([3, 1], abs=0.15)
    assert middle[1, :2] == pytest.approx([1, 1], abs=0.15)  # on the other side of its circle, which lies to its left


# --- in a simulation ---


@pytest.mark.slow
def test_movers_last_as_long_as_the_others() -> None:
    fan = t2d.TableFan(position_m=(2, 1, 1), rpm=60)
    closed = t2d.Door(position_m=(3, 0, 0)).mesh(1.0, 1.2)
    result = t2d.simulate([fan, closed], radar=QUICK, accuracy={"occlusion": False})
    assert len(result.cube) == len(QUICK.chirp_times_s(0.2))
    assert "TableFan" in result.settings["targets"][0]
    same = t2d.simulate([fan.mesh(1.0, 1.2), closed], radar=QUICK, accuracy={"occlusion": False})
    assert np.array_equal(np.asarray(result.cube), np.asarray(same.cube))
    with pytest.raises(InputError, match=r"movers alone have no end, got .*; give one of them as its mesh"):
        t2d.simulate(fan, radar=QUICK)


@pytest.mark.slow
def test_movers_stay_meshes_beside_ellipsoids() -> None:
    times = np.linspace(0, 0.2, 5)
    ball = Ellipsoids(np.full((1, 3), 0.1), np.tile([2.0, -1.0, 1.0], (5, 1, 1)), times)
    fan = t2d.TableFan(position_m=(2, 1, 1), rpm=60)
    both = t2d.simulate([ball, fan], radar=QUICK, method="ellipsoid", accuracy={"occlusion": False})
    alone = t2d.simulate(ball, radar=QUICK, method="ellipsoid")
    mesh = t2d.simulate(fan.mesh(0, 0.2), radar=QUICK, accuracy={"occlusion": False})
    error = both.adc.values - alone.adc.values - mesh.adc.values
    assert np.abs(error).max() < 1e-2 * np.abs(mesh.adc.values).max()


# --- as text ---


@pytest.mark.parametrize("entry", ENTRIES)
def test_texts_and_mappings_name_the_same(entry: str) -> None:
    known_mover: Mover = mover(entry)
    assert mover(yaml.safe_load(yaml.safe_dump(known_mover.model_dump(mode="json")))) == known_mover


def test_a_mover_from_a_text() -> None:
    fan = mover(" fan: 2, 1,1.2, rpm = 700 ,blades=5")
    assert fan == t2d.TableFan(position_m=(2, 1, 1.2), rpm=700, blades=5)
    assert isinstance(fan.mesh(0, 1), MovingMesh)
    own = {"kind": "door", "position_m": [1, 2, 0], "material": {"name": "steel", "relative_permittivity": math.inf}}
    assert mover(own).mesh(0, 1).material == t2d.Material(name="steel", relative_permittivity=math.inf)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("foo:1,2,3", "unknown mover 'foo'; choose one of fan, ceiling_fan, curtain, door, pet"),
        ("curtan:1,2,3", "unknown mover 'curtan'; did you mean curtain?"),
        ("fan", "written as kind:x,y,z,key=value or as a mapping with a kind, got 'fan'"),
        ({"position_m": [1, 2, 3]}, "or as a mapping with a kind, got {'position_m'"),
        ("fan:rpm=3", "fan key position_m is missing"),
        ("fan:1,2", "fan key position_m must be three numbers x, y, z"),
        ("fan:1,2,3,rpms=4", "unknown fan key 'rpms'; did you mean rpm?"),
        ("fan:1,2,3,rpm=4,rpm=5", "gives a key twice"),
        ("fan:1,2,3,position_m=4", "gives position_m twice"),
        ("fan:1,2,3,rpm=fast", "fan key rpm: got 'fast'"),
        ("fan:1,2,3,blades=0", "fan key blades: got '0'"),
        ("pet:1,2,0,animal=cow", "pet key animal: got 'cow', should be 'dog' or 'cat'"),
        ("pet:1,2,0,speed_mps=3", "a dog with hips 0.5 m high trots at 3 m/s; give a walk's speed_mps, up to 1.56"),
        ("pet:1,2,0,turn_radius_m=0.5", "turn_radius_m must be 1 or more for a dog of this size, got 0.5"),
        ("door:1,2,0,period_s=2", "cannot open and close in 1.5 s each; raise period_s to 3"),
        ("fan:2,1,1,radius_m=20", "fan key radius_m: got '20', should be less than or equal to 1"),
        ("fan:2,1,1,radius_m=1,blades=12", "vertices, more than 100000; lower radius_m or give fewer blades"),
        ("fan:2,1,1,radius_m=0.5,rpm=12000", "that fan's tips would move at 628.3 m/s, faster than sound; lower rpm"),
        ("fan:2,1,1,swing_period_s=1e-9", "swing_period_s: got '1e-9', should be greater than or equal to 0.05"),
        ("ceiling_fan:2,1,1,radius_m=4,blades=12", "vertices, more than 100000; lower radius_m"),
        ("ceiling_fan:2,1,1,chord_m=0.7", "chord_m must be at most radius_m, 0.6 m, got 0.7"),
        ("curtain:2,1,2,width_m=20,fold_m=0.021", "vertices, more than 100000; lower width_m"),
        ("curtain:2,1,2,wavelength_m=1e-9", "wavelength_m: got '1e-9', should be greater than"),
        ("door:2,1,0,width_m=20", "width_m: got '20', should be less than or equal to 10"),
        ("door:2,1,0,width_m=10,opening_s=0.05", "that door's edge would move at 523.6 m/s, faster than sound; raise opening_s"),
        ("door:2,1,0,thickness_m=1e-300", "thickness_m: got '1e-300', should be greater than"),
        ("pet:1,2,0,speed_mps=1e-300", "speed_mps: got '1e-300', should be greater than or equal to 0.05"),
    ],
)  # fmt: skip
def test_movers_that_cannot_be(entry: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        mover(entry)
    assert message in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    "entry",
    [
        "fan:2,1,1,radius_m=1,blades=6,rpm=3000", "ceiling_fan:2,1,1,radius_m=2,chord_m=0.2,blades=8",
        "curtain:2,1,2,width_m=20,height_m=20,fold_m=1",
    ],
)  # fmt: skip
def test_the_size_that_is_checked_is_that_of_the_mesh(entry: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """One vertex less is refused; a fan's hub, which no field changes, is not counted."""
    moving = mover(entry)
    vertices = len(moving.mesh(0, 1).rest) - (168 if "fan" in entry else 0)
    monkeypatch.setattr("t2d_rt.scene.movers.solids.MAX_VERTICES", vertices)
    mover(entry)
    monkeypatch.setattr("t2d_rt.scene.movers.solids.MAX_VERTICES", vertices - 1)
    with pytest.raises(InputError, match=f"has {vertices} vertices, more than {vertices - 1}"):
        mover(entry)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ((0, math.nan), "stop_s"),
        (("0", 1), "start_s"),
        ((None, 1), "start_s"),
        ((1, 1), "start_s < stop_s"),
        ((2, 1), "needs finite start_s < stop_s, got 2 and 1"),
    ],
)
def test_times_of_a_movers_mesh(times: tuple[object, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        mover("fan:2,1,1").mesh(*times)  # type: ignore[arg-type]


@pytest.mark.parametrize("duration_s", [0.02, 0.1, 1.0])
@pytest.mark.parametrize("rpm", [300, 3000])
def test_the_speed_of_a_fans_tips_is_found_in_records_of_any_length(rpm: float, duration_s: float) -> None:
    """From the side the tips come straight towards the radar, at omega R."""
    fan = t2d.TableFan(position_m=(3, 0, 1), rpm=rpm, heading_deg=90)
    _, fastest_mps = farthest_and_fastest(fan.mesh(0, duration_s), Radar.preset("table2"), (0, duration_s))
    assert fastest_mps == pytest.approx(2 * math.pi * rpm / 60 * fan.radius_m, rel=0.01)
