"""Outfits: cloth and shoes around the bodies, materials by part, and how they travel through simulations and records."""

from __future__ import annotations

import cmath
import math
import pickle

import numpy as np
import pytest

import builders
import t2d_rt as t2d
from t2d_rt.body.fit import fit
from t2d_rt.body.materials import resolve_material
from t2d_rt.body.outfit import OUTFITS, TOE_M, UPPER_M, Outfit, put_on
from t2d_rt.body.segments import SEGMENTS, segment_of_faces
from t2d_rt.body.template import bodies, template
from t2d_rt.core.errors import InputError
from t2d_rt.geometry.vectors import edge_cross
from t2d_rt.types import ByPart, Material
from t2d_rt.types.motion import CANONICAL_JOINTS

PLAIN = Outfit(cloth="clothed", bare="clothed", shoes="clothed", cloth_m=0, sole_m=0)
CLOTH, BARE, SHOES = 0, 1, 2
QUICK = {"radar": t2d.Radar.preset("table2", samples=64, prf_hz=5_000.0), "measure_error": False}


@pytest.fixture(scope="module")
def walk() -> t2d.Motion:
    return t2d.trim(builders.walk(), 1.0, 1.3)


@pytest.fixture(scope="module")
def step(walk: t2d.Motion) -> t2d.Motion:
    return t2d.trim(walk, 0, 0.12)


def of_joint(name: str, count: int) -> np.ndarray:
    weights = np.zeros((count, len(CANONICAL_JOINTS)))
    weights[:, CANONICAL_JOINTS.index(name)] = 1
    return weights


def test_cloth_around_a_ball_is_a_larger_ball() -> None:
    vertices, faces = builders.icosphere(3, 0.2)
    clothes = Outfit(cloth_m=0.02, sole_m=0)
    found = put_on(clothes, vertices, faces, of_joint("spine1", len(vertices)), {})
    assert np.linalg.norm(found, axis=1) == pytest.approx(0.22, abs=2e-5)  # normals of an icosphere are off by 0.1 %
    bare = put_on(clothes, vertices, faces, of_joint("head", len(vertices)), {})
    assert np.array_equal(bare, vertices)


@pytest.mark.parametrize("name", [*bodies(), "man@40"])
@pytest.mark.parametrize("outfit", [*OUTFITS.values(), Outfit(sole_m=0.06)])
def test_clothes_keep_the_surface_whole(walk, name: str, outfit: Outfit) -> None:
    pairs = [(template(name), template(name, outfit)), (fit(template(name), walk), fit(template(name, outfit), walk))]
    weights, faces = template(name).weights, template(name).faces
    wrists = [CANONICAL_JOINTS.index(f"{side}_wrist") for side in ("left", "right")]
    hands = np.isin(np.argmax(weights, axis=1), wrists) & (weights.max(axis=1) == 1)
    assert hands.any()
    for bare, clad in pairs:
        normals = [edge_cross(each.vertices[faces]) for each in (bare, clad)]
        over = (normals[0] * normals[1]).sum(axis=1) <= 0  # but for a few of stout bodies, between the legs
        assert np.linalg.norm(normals[1][over], axis=1).sum() < 2e-4 * np.linalg.norm(normals[1], axis=1).sum()
        assert clad.vertices[:, 2].min() == pytest.approx(bare.vertices[:, 2].min(), abs=1e-6)
        assert np.ptp(clad.vertices[:, 2]) == pytest.approx(np.ptp(bare.vertices[:, 2]), abs=0.004)
        assert all(np.array_equal(clad.joints[joint], place) for joint, place in bare.joints.items())
        assert np.array_equal(clad.vertices[hands], bare.vertices[hands])


@pytest.mark.parametrize("body", ["adult", "child"])
@pytest.mark.parametrize("sole_m", [0.025, 0.06])
def test_a_shoe_is_longer_than_the_foot_and_its_sole_as_thick_as_given(walk, body: str, sole_m: float) -> None:
    outfit = Outfit(sole_m=sole_m)
    bare, clad = fit(template(body), walk), fit(template(body, outfit), walk)  # whose ankles are low
    joints = [CANONICAL_JOINTS.index(name) for name in ("left_ankle", "left_foot")]
    foot = template(body).weights[:, joints].sum(axis=1) > 0.999
    lengths = [np.ptp(each.vertices[foot, 0]) for each in (bare, clad)]
    assert TOE_M <= lengths[1] - lengths[0] <= TOE_M + 2 * UPPER_M + 0.001
    normals = edge_cross(bare.vertices[template(body).faces])
    below, above = (foot[template(body).faces].all(axis=1) & side for side in (normals[:, 2] < 0, normals[:, 2] > 0))
    heights_m = (clad.vertices - bare.vertices)[..., 2][template(body).faces]
    assert heights_m[above].max() <= sole_m + UPPER_M
    assert np.median(heights_m[above]) == pytest.approx(sole_m, abs=UPPER_M)
    weight = -normals[below, 2] / -normals[below, 2].sum()
    assert weight[np.abs(heights_m[below]).max(axis=1) < 1e-6].sum() > 0.7  # the rest is the edge of the sole


@pytest.mark.parametrize("name", ["walk", "short_walk", "run"])
def test_shoes_stand_where_bare_feet_do(name: str) -> None:
    motion = t2d.example(name)
    bare, *shoes = (
        t2d.skin(motion, material=each).vertices[..., 2].min(axis=1)
        for each in ("skin", Outfit(sole_m=0.025), Outfit(sole_m=0.06))
    )
    for shod in shoes:
        assert np.median(shod) == pytest.approx(np.median(bare), abs=0.001)
        assert (shod - bare).max() < 1e-6
        assert (shod - bare).min() > -TOE_M  # at push-off the room before the toes is lowest


def test_every_face_is_of_one_part_which_is_that_of_its_segment(walk) -> None:
    mesh, fitted = t2d.skin(walk, material="dressed"), fit(template("adult", OUTFITS["dressed"]), walk)
    assert isinstance(mesh.material, ByPart)
    part, segment = mesh.material.part, np.array(list(SEGMENTS))[segment_of_faces(fitted)]
    area = np.linalg.norm(edge_cross(mesh.rest[mesh.faces]), axis=1)
    meant = np.where(
        np.char.endswith(segment, "foot"), SHOES, np.where(np.isin(segment, ["head", "neck"]), BARE, CLOTH)
    )
    meant[np.char.endswith(segment, "hand")] = BARE
    assert area[part != meant].sum() < 0.005 * area.sum()  # at the borders weights of several joints meet
    parts = [area[part == number].sum() / area.sum() for number in (CLOTH, BARE, SHOES)]
    assert sum(parts) == pytest.approx(1)
    assert parts == pytest.approx([0.8, 0.11, 0.09], abs=0.03)
    assert [each.material.part[list(SEGMENTS).index(name)] for each in [t2d.segments(walk, material="dressed")]
            for name in ("head", "left_hand", "right_foot", "chest")] == [BARE, BARE, SHOES, CLOTH]  # fmt: skip


@pytest.mark.usefixtures("coarse_bodies")
@pytest.mark.parametrize(
    "about",
    [
        {},
        {"method": "ellipsoid"},
        # Minor paths of a room have ellipsoids in place of facets, and ray tubes a reflection for each facet.
        {"scene": "living_room", "clutter": "none"},
        pytest.param({"bounces": 2}, marks=pytest.mark.slow),
    ],
    ids=["mesh", "ellipsoid", "room", "bounces"],
)
def test_a_plain_outfit_is_its_material_bit_for_bit(step, about) -> None:
    assert any(tier.scatterer == "ellipsoids" for tier in t2d.Accuracy().tiers)
    one, other = (t2d.simulate(step, material=each, **about, **QUICK) for each in ("clothed", PLAIN))
    assert np.array_equal(one.adc, other.adc)
    if not about.keys() - {"method"}:
        assert not np.array_equal(one.adc, t2d.simulate(step, material="dressed", **about, **QUICK).adc)


@pytest.mark.usefixtures("coarse_bodies")
@pytest.mark.parametrize("method", ["mesh", "ellipsoid"])
def test_recordings_keep_outfits_and_are_made_again(step, tmp_path, method) -> None:
    shoes = Material(name="wood", relative_permittivity=2.0)
    outfit = Outfit(name="clogs", shoes=shoes, sole_m=0.04)
    made = t2d.simulate(step, method=method, material=outfit, **QUICK)
    made.save(tmp_path / "clogs.zarr")
    kept = t2d.load_recording(tmp_path / "clogs.zarr")
    assert kept.experiment.material == outfit
    assert kept.settings["material"]["shoes"]["name"] == "wood"
    assert np.array_equal(kept.again().adc, made.adc)
    # A body that was skinned by hand, too: it keeps what it wears.
    own = t2d.skin(step, material=outfit) if method == "mesh" else t2d.segments(step, material=outfit)
    by_hand = t2d.simulate(own, **QUICK)
    by_hand.save(tmp_path / "by_hand.zarr")
    again = t2d.load_recording(tmp_path / "by_hand.zarr")
    assert again.experiment.targets[0].material == outfit
    assert np.array_equal(again.again().adc, by_hand.adc)


def test_truth_knows_of_shoes(step) -> None:
    ranges_m = [
        t2d.simulate(step, material=each, **QUICK)
        .truth_at(np.array([0.02, 0.06, 0.1]), visible=False)
        .segment_range_m.values
        for each in ("dressed", PLAIN)
    ]
    apart_m = np.abs(ranges_m[0] - ranges_m[1]).max(axis=(0, 1))
    feet, shins = (np.array([name.endswith(end) for name in SEGMENTS]) for end in ("foot", "shank"))
    assert apart_m[feet].min() > 0.0015 > apart_m[~feet & ~shins].max()  # shoes are longer than feet, and shins shorter


def test_an_outfit_is_written_as_its_fields(walk) -> None:
    fields = {"targets": [{"kind": "file", "file": "walk"}], "radar": "table2"}
    made = t2d.Experiment(**fields, material={"shoes": "skin", "sole_m": 0.0})
    assert made.material == Outfit(shoes="skin", sole_m=0.0)
    assert t2d.Experiment.model_validate_json(made.model_dump_json()) == made
    assert t2d.Experiment(**fields, material={"name": "x", "relative_permittivity": 2.0}).material == Material(
        name="x", relative_permittivity=2.0
    )
    wrong = {
        "unknown field .* 'colour'": {"cloth": "skin", "colour": "red"}, "did you mean sole_m": {"sole": 1}, "got {}": {},
        "sole_m must": {"sole_m": math.nan}, "outfit's cloth 'gold'": {"cloth": "gold"},
    }  # fmt: skip
    for message, told in wrong.items():
        with pytest.raises(InputError, match=message):
            t2d.Experiment(**fields, material=told)


def test_a_dressed_template_is_pickled_as_it_is() -> None:
    clad = template("woman", OUTFITS["coat"])
    assert pickle.loads(pickle.dumps(clad)) is clad
    assert template("man@30", OUTFITS["coat"]).like is template("man", OUTFITS["coat"]).vertices


def test_shoes_are_of_vinyl() -> None:
    shoe = resolve_material("shoe", 24e9)  # ITU-R P.2040-3 up to 40 GHz
    assert shoe.relative_permittivity == 3.62
    assert shoe.conductivity_s_per_m == pytest.approx(0.07413, rel=1e-4)
    gamma = resolve_material("shoe", 77e9).reflection(77e9)
    assert 20 * math.log10(abs(gamma)) == pytest.approx(-10.15, abs=0.05)
    # An upper of 4 mm over a gap of air and skin, all passes added in power: the -4.8 dB that the page tells of.
    face, skin_face = abs(gamma) ** 2, abs(resolve_material("skin", 77e9).reflection(77e9)) ** 2
    index = cmath.sqrt(resolve_material("shoe", 77e9).permittivity(77e9))
    passed = math.exp(4 * math.pi * 77e9 / 299792458 * index.imag * UPPER_M)
    through = 1 - face**2 * passed**2
    back, forth = face + (1 - face) ** 2 * passed**2 * face / through, (1 - face) ** 2 * passed / through
    assert 10 * math.log10(back + forth**2 * skin_face / (1 - back * skin_face)) == pytest.approx(-4.79, abs=0.01)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"cloth_m": 0.5}, "a coat"),
        ({"sole_m": -0.1}, "0 none"),
        ({"cloth": 3}, "a name or a Material"),
        ({"name": 2}, "a text"),
        ({"cloth": "coat"}, "unknown material of an outfit's cloth 'coat'"),
        ({"shoes": "leather"}, "unknown material of an outfit's shoes 'leather'"),
    ],
)
def test_wrong_outfits_are_refused(fields, message) -> None:
    with pytest.raises(InputError, match=message):
        Outfit(**fields)


def test_only_bodies_wear_outfits(walk) -> None:
    with pytest.raises(InputError, match="an outfit is worn by a Motion"):
        t2d.simulate(t2d.skin(walk), material="dressed")
    ball = t2d.Ellipsoids([[0.1] * 3], np.array([[[2.0, 1, 1]]] * 2), [0.0, 0.3], material="pec")
    one, both = (t2d.simulate(each, method="ellipsoid", material="dressed") for each in (walk, [walk, ball]))
    alone = t2d.simulate(ball)
    apart = np.asarray(both.adc[:]) - np.asarray(one.adc[:]) - np.asarray(alone.adc[: len(both.adc)])
    assert np.abs(apart).max() < 1e-4 * np.abs(np.asarray(alone.adc)).max()  # what is no body keeps its own material
    with pytest.raises(InputError, match="unknown material 'Dresed'; did you mean dressed"):
        t2d.simulate(walk, material="Dresed")
    with pytest.raises(InputError, match="a material or an Outfit"):
        t2d.skin(walk, material=ByPart(("skin",), np.array([0])))  # type: ignore[arg-type]
