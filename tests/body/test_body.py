from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import builders
from builders import rest_pose
from measures import volume
from t2d_rt.body import bodies, depth_m, regressed_joints, skin, template
from t2d_rt.body.fit import fit, stance
from t2d_rt.body.pose import posing
from t2d_rt.body.rotations import between, matrices, quaternion, swing
from t2d_rt.body.skin import SOFT_M, _flatten, blend, blend_basis, bone_weights, linear_track
from t2d_rt.core.errors import InputError
from t2d_rt.core.resources import resource
from t2d_rt.motion import load_motion, track
from t2d_rt.motion.kinematics import INDEX, motion_of, poses_of
from t2d_rt.scattering.refinement import refined
from t2d_rt.types.motion import CANONICAL_JOINTS, Motion

WALK, RUN, STYLISED = "12_01_walk.bvh", "iclone_002_03_run_jog.bvh.gz", "131_01_walk_300frames.bvh"


def moved(motion: Motion, rotation: Rotation, shift: np.ndarray, scale: float = 1.0) -> Motion:
    flat = motion.rotations.reshape(-1, 4)
    return replace(
        motion,
        joints=rotation.apply(scale * motion.joints.reshape(-1, 3)).reshape(motion.joints.shape) + shift,
        rotations=(rotation * Rotation.from_quat(flat)).as_quat().reshape(motion.rotations.shape),
    )


def with_bone(motion: Motion, joint: str, factor: float) -> Motion:
    """The motion with the bone above a joint made longer, everything below shifted."""
    joints = motion.joints.copy()
    index, below = motion.index(joint), [motion.index(joint)]
    for i, parent in enumerate(motion.parents):
        if parent in below:
            below.append(i)
    joints[:, below] += (factor - 1) * (joints[:, index] - joints[:, motion.parents[index]])[:, None]
    return replace(motion, joints=joints)


@pytest.fixture(scope="module")
def walk() -> Motion:
    return builders.walk()


def test_the_template_is_one_closed_well_shaped_surface():
    body = template()
    import trimesh

    cage = trimesh.Trimesh(body.vertices, body.faces, process=False)
    assert cage.is_watertight
    assert cage.euler_number == 2
    assert cage.is_winding_consistent
    assert cage.volume == pytest.approx(0.0725, rel=0.02)
    assert np.ptp(body.vertices[:, 2]) == pytest.approx(1.837, abs=0.01)
    assert body.vertices[:, 2].min() == pytest.approx(0, abs=2e-3)
    assert len(body.faces) == 6402  # as the README says
    assert np.degrees(cage.face_angles).min() > 35
    assert np.isin(np.bincount(body.faces.ravel()), (4, 5, 6, 7, 8)).all()


def test_the_templates_weights_are_a_partition_with_four_influences():
    weights = template().weights
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-12)
    assert (weights >= 0).all()
    assert np.count_nonzero(weights, axis=1).max() <= 4


def test_rings_enclose_their_joints_and_give_them_at_rest():
    body = template()
    assert set(body.rings) == {"head"} | {
        f"{s}_{j}" for s in ("left", "right") for j in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
    }
    for name, (index, weight) in body.rings.items():
        offset = body.vertices[index] - body.joints[name]
        assert len(index) >= 7
        assert weight.max() < 0.3
        # Around: seen along the ring's axis no gap wider than 120 degrees.
        plane = np.linalg.svd(offset - offset.mean(0))[2][:2]
        angles = np.sort(np.arctan2(*(offset @ plane.T).T))
        assert np.diff([*angles, angles[0] + 2 * np.pi]).max() < np.radians(120), name
    for name, joint in regressed_joints(body, body.vertices).items():
        np.testing.assert_allclose(joint, body.joints[name], atol=1e-4)


@pytest.mark.parametrize("seed", [None, 1, 2])
@pytest.mark.parametrize("ends", [True, False])
def test_a_motion_that_holds_the_rest_pose_gives_the_rest_surface_whatever_the_files_zero_pose(seed, ends):
    surface = skin(rest_pose(seed=seed, ends=ends))
    np.testing.assert_allclose(surface.vertices[2], template().vertices, atol=1e-6)
    np.testing.assert_allclose(surface.rest, template().vertices, atol=2e-3)


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(
    angle=st.floats(-3, 3), x=st.floats(-5, 5), y=st.floats(-5, 5), scale=st.floats(0.3, 1.5),
)  # fmt: skip
def test_turning_shifting_and_scaling_the_motion_does_the_same_to_the_surface(angle, x, y, scale):
    rotation, shift = Rotation.from_euler("z", angle), np.array([x, y, 0.0])
    motion = rest_pose(seed=3)
    expected = rotation.apply(scale * skin(motion).vertices[0]) + shift
    np.testing.assert_allclose(skin(moved(motion, rotation, shift, scale)).vertices[0], expected, atol=1e-9)


def test_a_rotation_in_any_direction_after_calibration_carries_the_surface_rigidly():
    motion = rest_pose(seed=4, frames=9)
    surface = skin(motion)
    rotation, shift = Rotation.from_euler("xyz", [0.7, -1.1, 2.0]), np.array([1.0, 2.0, 3.0])
    tilted = moved(motion, rotation, shift)
    tumbling = skin(motion, track=lambda t: (tilted.joints[: len(t)], tilted.rotations[: len(t)]))
    np.testing.assert_allclose(tumbling.vertices[0], rotation.apply(surface.vertices[0]) + shift, atol=1e-9)


@pytest.mark.parametrize(
    "name", [WALK, RUN, STYLISED, "14_14_jumping_jacks.bvh", "momask_22j_120frames.bvh", "bvhtoolbox_walk01.bvh"]
)
def test_the_surface_sits_on_the_motions_joints(name):
    motion = load_motion(resource("motions", name))
    joints = regressed_joints(template(), skin(motion, track=track(motion)).vertices)
    errors = np.stack([np.linalg.norm(p - motion.joints[:, motion.index(n)], axis=1) for n, p in joints.items()])
    assert errors.mean() < 0.006
    assert errors.max() < 0.025


def test_a_longer_forearm_is_longer_but_not_thicker():
    body, plain = template(), fit(template(), rest_pose())
    longer = fit(body, with_bone(with_bone(rest_pose(), "left_wrist", 1.3), "right_wrist", 1.3))
    axis = body.joints["left_wrist"] - body.joints["left_elbow"]
    length = np.linalg.norm(axis)

    def girth(joints, vertices):
        offset = vertices - (joints["left_wrist"] + joints["left_elbow"]) / 2
        along = offset @ axis / length
        middle = (np.abs(along) < 0.03) & (np.linalg.norm(offset, axis=1) < 0.1)
        return np.linalg.norm(offset[middle] - along[middle, None] * axis / length, axis=1).mean()

    stretched = np.linalg.norm(longer.joints["left_wrist"] - longer.joints["left_elbow"])
    assert stretched == pytest.approx(1.3 * length, rel=1e-9)
    assert longer.scale == pytest.approx(1, rel=1e-9)
    assert girth(longer.joints, longer.vertices) == pytest.approx(girth(plain.joints, plain.vertices), rel=0.06)
    hand = template().weights[:, CANONICAL_JOINTS.index("left_wrist")] > 0.999
    np.testing.assert_allclose(np.ptp(longer.vertices[hand], axis=0), np.ptp(plain.vertices[hand], axis=0), rtol=1e-6)


def test_longer_legs_raise_stature_and_the_head_follows():
    motion = rest_pose()
    for joint in ("left_knee", "right_knee", "left_ankle", "right_ankle"):
        motion = with_bone(motion, joint, 1.2)
    fitted = fit(template(), motion)
    assert 1.05 < fitted.scale < 1.2
    head = template().joints["head_top"] - template().joints["head"]
    np.testing.assert_allclose(fitted.joints["head_top"] - fitted.joints["head"], fitted.scale * head, atol=1e-9)


def test_feet_stand_level_on_the_ground_while_the_file_says_otherwise(walk):
    """The posed soles of the stance foot are level although 12_01's ankle-to-toe line is flatter than the body's."""
    surface = skin(walk, track=track(walk))
    lowest = surface.vertices[..., 2].min(1)
    assert np.abs(np.median(lowest)) < 0.015
    assert lowest.min() > -0.04


def test_soles_are_level_in_stance(walk):
    """Fits a plane to each sole; taken along the file's ankle-to-toe line it would be pitched by 10 degrees."""
    body, vertices = template(), skin(walk, track=track(walk)).vertices
    for side in ("left", "right"):
        ankle = CANONICAL_JOINTS.index(f"{side}_ankle")
        sole = vertices[:, (body.weights[:, ankle] > 0.5) & (body.vertices[:, 2] < 0.015)]
        frames = stance(walk, side).frames
        normal = np.linalg.svd(sole[frames] - sole[frames].mean(1, keepdims=True))[2][:, 2]
        tilt = np.degrees(np.arccos(np.abs(normal[:, 2])))
        assert len(frames) > 20
        assert np.median(tilt) < 5


def test_a_hand_points_where_the_files_hand_does():
    motion, rest = rest_pose(seed=6), template().joints
    rotation = Rotation.from_rotvec([0, 0, np.radians(40)])
    wrist, hand = motion.index("left_wrist"), motion.index("left_hand")
    joints = motion.joints.copy()
    joints[:, hand] = joints[:, wrist] + rotation.apply(rest["left_hand"] - rest["left_wrist"])
    fingers = template().weights[:, wrist] > 0.999
    middle = skin(replace(motion, joints=joints)).vertices[0, fingers].mean(0)
    expected = joints[0, wrist] + rotation.apply(template().vertices[fingers].mean(0) - rest["left_wrist"])
    # The file tells the direction only: a small twist is left open.
    np.testing.assert_allclose(middle, expected, atol=0.01)


@pytest.mark.parametrize("joints", [("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist")])
def test_knees_and_elbows_bend_in_the_right_direction(walk, joints):
    """Where the limb bends, kneecap and point of the elbow are on the outer side."""
    body, vertices = template(), skin(walk, track=track(walk)).vertices
    above, here, below = (walk.joints[:, walk.index(f"left_{joint}")] for joint in joints)
    bend = here - (above + below) / 2
    bent = np.linalg.norm(bend, axis=1) > 0.1 * np.linalg.norm(above - below, axis=1)
    ring = body.rings[f"left_{joints[1]}"][0]
    first, middle, last = (body.joints[f"left_{joint}"] for joint in joints)
    tip = ring[np.argmax((body.vertices[ring] - middle) @ (middle - (first + last) / 2))]
    towards = vertices[:, tip] - here
    cosine = (towards * bend).sum(1)[bent] / np.linalg.norm(bend[bent], axis=1) / np.linalg.norm(towards[bent], axis=1)
    assert np.count_nonzero(bent) > 20
    assert cosine.min() > 0.5  # one vertex of a ring of 14, elbows nearly straight


def test_the_head_faces_where_the_walk_goes(walk):
    surface = skin(walk, track=track(walk))
    nose = np.argmax(template().vertices[:, 0] * (template().vertices[:, 2] > 1.6))
    gaze = surface.vertices[:, nose] - walk.joints[:, walk.index("head")]
    course = walk.joints[-1, 0] - walk.joints[0, 0]
    cosine = (gaze[:, :2] @ course[:2]) / np.linalg.norm(gaze[:, :2], axis=1) / np.linalg.norm(course[:2])
    assert cosine.min() > 0.8


@pytest.mark.slow
def test_the_posed_surface_keeps_its_volume(walk):
    surface = skin(walk, track=track(walk))

    ratio = volume(surface.vertices, surface.faces) / volume(surface.rest, surface.faces)
    assert 0.95 < ratio.min() <= ratio.max() < 1.05


def test_a_twisted_wrist_does_not_wring_the_forearm():
    """The forearm takes up half the twist: at 120 degrees it keeps 80 % of its girth (plain blending: half)."""
    motion = rest_pose(frames=40)
    rest = template().joints
    axis = rest["left_wrist"] - rest["left_elbow"]
    axis /= np.linalg.norm(axis)
    twisted = motion.rotations.copy()
    wrist = motion.index("left_wrist")
    twisted[0, wrist] = (Rotation.from_rotvec(np.radians(120) * axis) * Rotation.from_quat(twisted[0, wrist])).as_quat()
    surface = skin(motion, track=lambda t: (motion.joints[:1], twisted[:1]))
    offset = template().vertices - rest["left_elbow"]
    along = offset @ axis
    length = np.linalg.norm(rest["left_wrist"] - rest["left_elbow"])
    forearm = (
        (along > 0.3 * length) & (along < length) & (np.linalg.norm(offset, axis=1) < 0.28) & (offset[:, 1] > -0.02)
    )

    def radius(vertices):
        offset = vertices[forearm] - rest["left_elbow"]
        across = offset - (offset @ axis)[:, None] * axis
        return np.linalg.norm(across - across.mean(0), axis=1)

    posed = surface.at(np.zeros(1))[0]
    for low in np.arange(0.3, 1.0, 0.1):
        part = (along[forearm] >= low * length) & (along[forearm] < (low + 0.1) * length)
        assert radius(posed)[part].mean() > 0.8 * radius(template().vertices)[part].mean()


def test_skinning_by_blocks_is_the_plain_sum_over_bones(walk):
    """A float64 twin: sum over bones of weight (R (v - r) + o)."""
    from t2d_rt.body.pose import BONES, posing

    fitted = fit(template(), walk)
    pose = posing(fitted, walk)
    rotation, origin = pose.bones(walk.joints[:70], walk.rotations[:70])
    weights = bone_weights(fitted)
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-12)
    expected = np.zeros((70, len(fitted.vertices), 3))
    carrier = [b.replace("upper_arm", "shoulder").replace("forearm", "elbow") for b in BONES]
    for i, name in enumerate(carrier):
        offset = fitted.vertices - fitted.joints[name]
        expected += weights[:, i, None] * (np.einsum("kij,vj->kvi", rotation[:, i], offset) + origin[:, i, None])
    np.testing.assert_allclose(skin(walk).vertices[:70], expected, atol=1e-9)
    assert blend_basis(fitted).shape == (len(fitted.vertices), 4 * len(BONES))


def test_the_surface_is_smooth_in_time(walk):
    """Second differences shrink fourfold when the step is halved: no kink between or at frames."""
    surface = skin(walk, track=track(walk))
    start, step = 1.0, 1 / walk.rate_hz / 8

    def bend(step):
        t = start + step * np.arange(round(0.2 / step))
        return np.abs(np.diff(surface.at(t), 2, axis=0)).max()

    assert bend(step) / bend(step / 2) == pytest.approx(4, rel=0.1)


def test_a_motion_without_track_is_joined_by_straight_lines(walk):
    surface = skin(walk)
    ends = surface.at(np.array([1.0, 1.0 + 1 / walk.rate_hz]))
    middle = surface.at(np.array([1.0 + 0.5 / walk.rate_hz]))
    np.testing.assert_allclose(middle[0], ends.mean(0), atol=1e-4)


def lying_after(walk: Motion) -> Motion:
    """The walk, then 5 s on the back with knees drawn up, resting on the heels with the toes in the air."""
    poses = poses_of(walk)
    count = round(5 * walk.rate_hz)
    local = np.tile(poses.local[:1], (count, 1, 1))
    local[:, 0] = Rotation.from_euler("y", -90, degrees=True).as_quat()
    for side in ("left", "right"):
        for joint, pitch in (("hip", -50), ("knee", 120), ("ankle", -20)):
            local[:, INDEX[f"{side}_{joint}"]] = Rotation.from_euler("y", pitch, degrees=True).as_quat()
    down = replace(poses, root=np.tile([0.0, 0.0, 0.2], (count, 1)), local=local)
    low = min(down.joint(f"{side}_ankle")[0, 2] for side in ("left", "right"))
    down = replace(down, root=down.root - [0.0, 0.0, low - 0.07])
    both = replace(poses, root=np.concatenate([poses.root, down.root]), local=np.concatenate([poses.local, local]))
    return motion_of(both)


def test_heels_of_one_who_lies_do_not_tell_how_a_foot_stands(walk):
    """A foot that rests on its heel under a bent knee was taken for one that stands: the walk before tilted."""
    whole = lying_after(walk)
    times_s = walk.times_s[::10]
    both, alone = (skin(each).at(times_s) for each in (whole, motion_of(poses_of(walk))))
    feet = template().weights[:, [CANONICAL_JOINTS.index(f"{side}_foot") for side in ("left", "right")]].max(1) > 0.5
    assert np.abs(both[:, feet] - alone[:, feet]).max() < 0.01
    assert skin(whole).vertices[..., 2].min() > -SOFT_M


def test_flesh_gives_way_to_the_floor(walk):
    heights = np.array([-0.2, -0.05, -0.011, -0.01, -0.005, 0.3])
    flat = heights.copy()
    _flatten(flat)
    assert np.all(np.diff(flat) >= 0)
    assert flat[0] >= -SOFT_M
    np.testing.assert_array_equal(flat[3:], heights[3:])
    lying = moved(rest_pose(frames=40), Rotation.from_euler("y", -90, degrees=True), np.array([0.0, 0.0, 0.06]))
    assert depth_m(lying) > 0.03  # the middle of the trunk is 6 cm over the floor, and its skin below
    assert -SOFT_M <= skin(lying).vertices[..., 2].min() < -0.015
    sunk = replace(lying, joints=lying.joints - [0.0, 0.0, 1.0])  # its floor is elsewhere
    assert skin(sunk).vertices[..., 2].min() < -1.0


def test_soles_give_way_to_the_floor_where_it_is_theirs(walk):
    """What is less than 1 cm deep stays, bit for bit, as do soles on a floor that lies lower."""
    body = fit(template(), walk)
    plain = blend(blend_basis(body), *posing(body, walk).bones(*linear_track(walk)(walk.times_s)))
    vertices = skin(walk).vertices
    assert plain[..., 2].min() < -1.2 * SOFT_M  # a toe that bends late
    assert vertices[..., 2].min() >= -SOFT_M
    np.testing.assert_array_equal(vertices[plain[..., 2] > -SOFT_M / 2], plain[plain[..., 2] > -SOFT_M / 2])
    np.testing.assert_array_equal(vertices[..., :2], plain[..., :2])
    down = np.linspace(0.0, 0.3, len(walk.times_s))[:, None] * [0.0, 0.0, 1.0]
    ramp = replace(walk, joints=walk.joints - down[:, None])
    assert skin(ramp).vertices[..., 2].min() < -0.25
    run = load_motion(resource("motions", RUN))  # its floor is where its lowest joint is, a toe's middle
    assert skin(run).vertices[..., 2].min() < -0.08


def test_lying_and_hand_standing_bodies_are_posed_too():
    for rotation in (Rotation.from_euler("x", 90, degrees=True), Rotation.from_euler("y", 180, degrees=True)):
        motion = moved(rest_pose(seed=5), rotation, np.array([0, 0, 1.0]))
        surface = skin(motion)
        joints = regressed_joints(template(), surface.vertices)
        errors = [np.linalg.norm(p - motion.joints[:, motion.index(n)], axis=1).max() for n, p in joints.items()]
        assert max(errors) < 0.025
        assert np.isfinite(surface.vertices).all()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_rotation_helpers_agree_with_scipy(seed):
    one, other = Rotation.random(2, rng=seed)
    np.testing.assert_allclose(matrices(one.as_quat()), one.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(matrices(quaternion(one.as_matrix())), one.as_matrix(), atol=1e-12)
    a, b = one.apply([1, 0, 0]), other.apply([1, 0, 0])
    np.testing.assert_allclose(swing(a, b) @ a, b, atol=1e-9)
    part = Rotation.from_rotvec(0.3 * (one.inv() * other).as_rotvec())
    np.testing.assert_allclose(between(one.as_matrix(), other.as_matrix(), 0.3), (one * part).as_matrix(), atol=1e-9)


def test_an_unknown_body_lists_the_known_ones():
    assert "adult" in bodies()
    with pytest.raises(InputError, match="unknown body 'giant'; choose one of adult, child, heavy, man, old, woman"):
        skin(rest_pose(), "giant")
    with pytest.raises(InputError, match=r"unknown body '\.\./adult'; did you mean adult\?"):
        template("../adult")


def test_a_motion_with_zero_bones_is_refused():
    motion = rest_pose()
    joints = motion.joints.copy()
    joints[:, motion.index("left_knee")] = joints[:, motion.index("left_hip")]
    with pytest.raises(InputError, match="left_hip to left_knee are not between 1 mm and 10 m"):
        skin(replace(motion, joints=joints))


@pytest.mark.parametrize("name", ["../pyproject.toml", "/etc/hostname", "", ".", "missing.npz", "a\0b"])
def test_resources_do_not_lead_out_of_their_folder(name):
    with pytest.raises(InputError, match=r"is not one of the shipped meshes; choose one of .*adult\.npz"):
        resource("meshes", name)


@pytest.mark.slow
def test_bodies_of_like_size_share_their_facets(walk):
    """A person 2 % taller has the same facets, on a surface of his own; one half as tall again has others."""
    sizes = {scale: skin(moved(walk, Rotation.identity(), np.zeros(3), scale)) for scale in (1.0, 1.02, 1.5)}
    one, like, tall = sizes.values()
    np.testing.assert_array_equal(one.refined_as, like.refined_as)
    np.testing.assert_array_equal(one.sagitta_rad, like.sagitta_rad)
    found = [refined(each, 1600.0, 3.05, [1.0], 10**6)[0] for each in (one, like, tall)]
    assert found[0] is found[1]
    assert len(found[2].faces) > 1.3 * len(found[0].faces)
    places = [facets.at(each.rest) for facets, each in zip(found[:2], (one, like), strict=True)]
    assert np.ptp(places[1][:, 2]) == pytest.approx(1.02 * np.ptp(places[0][:, 2]), rel=1e-3)
