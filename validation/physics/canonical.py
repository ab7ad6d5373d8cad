"""Canonical targets against exact results: where physical optics holds, and what a single bounce leaves out."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

import t2d_rt as t2d
from t2d_rt.backend import select
from t2d_rt.propagation.clutter import static_paths
from t2d_rt.propagation.mirrors import Mirrors
from t2d_rt.radar.synthesize import synthesize
from t2d_rt.scattering.clutter import mirror_echoes
from t2d_rt.types import PEC, MovingMesh, Radar, Scene, Surface
from validation.physics import exact
from validation.physics.rcs import TIMES_S, read_rcs, sphere
from validation.physics.turntable import aspects, db, mesh_fields, on_turntable, rcs
from validation.report import Check, Section, new_figure, save_chart

LIMIT_DB = 0.3
MIE_TRUTH = ((1.028, 3.65495), (2.0, 1.00814), (5.0, 1.16884), (10.0, 0.92923), (50.0, 0.99592))
"""sigma / (pi a^2) at ka; docs/physics.md, eq. 6."""
KA = np.geomspace(0.1, 500, 4000)
FACET_KA = np.geomspace(0.1, 500, 38)
LARGE_KA = 10.0
"""From here on the facets are held to the exact sums of physical optics."""
TURNS = 6
"""Sides from which a sphere of facets is seen: where its facets happen to lie changes the RCS a little."""
NEAR_M, RANGE_M, FAR_M = 1.0, 10.0, 1e4
SHOWN_DB, NEAR_SHOWN_DB = 30.0, 25.0
"""Patterns are compared down to so far below their peak, nulls having no level; near by, lobes of the facets' lattice lie below."""
PLATE_M, CYLINDER_M = (0.10, 0.10), (0.04, 0.25)
"""Width and height; radius and length, of a forearm."""
CYLINDER_RANGES_M = (3.0, 10.0, 30.0)
SPHEROID_M = (0.08, 0.22)
CORNER_M = 0.10
CORNER_RANGE_M = 3.0
NEAR_AXIS_DEG = 10.0
"""The single plates' lobes have nulls: a level on the very axis says little."""
SYMMETRIC_KA = (100.0, 190.4)
"""Spheres whose facets' lattice, seen along its axis of symmetry, returns lobes that add up."""
BODY_KA = (27, 260)
"""Of a wrist of 17 mm radius and of a chest of 16 cm at 77 GHz."""


def run() -> Section:
    radar = Radar.preset("table2")
    mie = np.array([exact.mie(ka) for ka in KA])
    optics_error = db(exact.sphere_optics(KA) / mie)
    facets = np.array([_sphere(radar, ka) for ka in FACET_KA])
    facet_error = db(facets / exact.sphere_optics(FACET_KA)[:, None])
    valid = {bar: _valid_from(KA, optics_error, bar) for bar in (1.0, LIMIT_DB)}
    widths = {along: np.array([exact.cylinder_width(ka, along=along) for ka in KA]) for along in (True, False)}
    width_error = {along: db(exact.cylinder_width_optics(KA) / width) for along, width in widths.items()}
    axial = [_axial_sphere(radar, ka) for ka in SYMMETRIC_KA]
    plates = [_plate(radar), _near_plate(radar), _cylinder(radar)]
    dihedral, *trihedrals = _dihedral(radar), _trihedral(radar, triangular=False), _trihedral(radar, triangular=True)
    corners = [dihedral, *trihedrals]
    spheres = [_read_sphere(ka) for ka in (30, 100, 300, 900)]
    cylinders = [_read_cylinder(range_m) for range_m in CYLINDER_RANGES_M]
    room = [_room_corner(radar, walls) for walls in (2, 3)]
    checks = [
        Check(
            what="Mie series against tabled values, ka 1.028 to 50, worst",
            measured=max(abs(exact.mie(ka) / value - 1) for ka, value in MIE_TRUTH),
            limit=1e-5,
            unit="",
        ),
        Check(what="physical optics within 1 dB of Mie from ka", measured=valid[1.0], limit=10, unit=""),
        Check(what="physical optics within 0.3 dB of Mie from ka", measured=valid[LIMIT_DB], limit=BODY_KA[0], unit=""),
        Check(
            what=f"spheres of facets against exact physical optics, ka >= {LARGE_KA:g}, {TURNS} sides, worst",
            measured=float(np.abs(facet_error[FACET_KA >= LARGE_KA]).max()),
            limit=LIMIT_DB,
            unit="dB",
        ),
        Check(
            what="spheres read from the ADC cube against Mie, ka 30 to 900",
            measured=_worst(spheres),
            limit=LIMIT_DB,
            unit="dB",
        ),
        Check(
            what="cylinder read from the ADC cube, broadside at 3, 10, 30 m",
            measured=_worst(cylinders),
            limit=LIMIT_DB,
            unit="dB",
        ),
        *(
            Check(what=f"{p.name}, {p.span} to -{p.shown_db:g} dB", measured=p.worst_db, limit=LIMIT_DB, unit="dB")
            for p in (*plates, dihedral)
        ),
        Check(
            what="spheroid 8 x 22 cm end on, far away, against its exact sum",
            measured=_spheroid_tip(radar),
            limit=LIMIT_DB,
            unit="dB",
        ),
        Check(
            what="corners of two and of three metal walls of a room, image theory",
            measured=_worst(room),
            limit=0.01,
            unit="dB",
        ),
    ]
    return Section(
        title="Canonical targets against exact results",
        checks=checks,
        note=_note(
            valid, {along: _valid_from(KA, error, LIMIT_DB) for along, error in width_error.items()}, corners, plates[1]
        ),
        table=[*spheres, *axial, *cylinders, *(p.row() for p in corners), *room],
        charts=[
            _ka_chart(mie, optics_error, facets, facet_error),
            _width_chart(width_error),
            _pattern_chart(*plates),
            _corner_chart(corners),
        ],
    )


class Pattern:
    """RCS over aspect: of facets, of physical optics in closed form, and the truth where that is another."""

    def __init__(
        self, name: str, angle_rad: np.ndarray, facets: np.ndarray, optics: np.ndarray | None = None,
        truth: np.ndarray | None = None, *, shown_db: float = SHOWN_DB,
    ) -> None:  # fmt: skip
        self.name, self.angle_deg = name, np.degrees(angle_rad)
        self.facets, self.shown_db = facets, shown_db
        self.optics = facets if optics is None else optics
        self.truth = facets if truth is None else truth

    @property
    def title(self) -> str:
        """The target alone."""
        return self.name.split(",")[0]

    @property
    def span(self) -> str:
        return f"{self.angle_deg[0]:g} to {self.angle_deg[-1]:g} degrees"

    @property
    def worst_db(self) -> float:
        """Of the facets against the closed form, where it is not in a null."""
        return self.worst_to(self.shown_db)

    def worst_to(self, shown_db: float) -> float:
        """The same down to `shown_db` below the peak."""
        seen = self.optics > self.optics.max() * 10 ** (-shown_db / 10)
        return float(np.abs(db(self.facets[seen] / self.optics[seen])).max())

    @property
    def missing_db(self) -> float:
        """How much less than the truth on the axis the facets return at most within NEAR_AXIS_DEG of it."""
        return float(db(self.truth.max()) - db(self._near_axis.max()))

    @property
    def _near_axis(self) -> np.ndarray:
        return self.facets[np.abs(self.angle_deg) <= NEAR_AXIS_DEG]

    def row(self) -> dict[str, object]:
        name = f"{self.name}, at most within {NEAR_AXIS_DEG:g} degrees of its axis, all bounces"
        return _row(name, "-", float(self._near_axis.max()), float(self.truth.max()))


def _row(target: str, range_m: float | str, measured: float, expected: float) -> dict[str, object]:
    measured, expected = float(db(measured)), float(db(expected))
    return {
        "target": target, "range m": range_m, "measured dBsm": round(measured, 3), "exact dBsm": round(expected, 3),
        "error dB": round(measured - expected, 4),
    }  # fmt: skip


def _worst(rows: list[dict[str, object]]) -> float:
    return max(abs(float(str(row["error dB"]))) for row in rows)


def _valid_from(ka: np.ndarray, error_db: np.ndarray, bar_db: float) -> float:
    """The ka beyond which the error stays within a bar."""
    outside = np.flatnonzero(np.abs(error_db) > bar_db)
    return float(ka[outside[-1] + 1]) if len(outside) else float(ka[0])


# --- spheres ---


def _sphere(radar: Radar, ka: float, *, along_axis: bool = False) -> np.ndarray:
    """sigma / (pi a^2) of a sphere of facets from TURNS sides, or first of all along an axis of symmetry; default fineness."""
    radius = ka * radar.wavelength_m / (2 * math.pi)
    vertices, faces = sphere(radius, np.zeros(3), subdivisions=4)
    if not along_axis:
        vertices = Rotation.random(rng=np.random.default_rng(round(1e3 * ka))).apply(vertices)
    ball = on_turntable(vertices, faces, aspects(0, 60, TURNS), radar.tx_position_m + [RANGE_M + radius, 0, 0])
    near = (RANGE_M / (RANGE_M + radius)) ** 2
    return rcs(mesh_fields(ball, radar, occlusion=False)[0], RANGE_M) / (math.pi * radius**2 * near)


def _axial_sphere(radar: Radar, ka: float) -> dict[str, object]:
    area = math.pi * (ka * radar.wavelength_m / (2 * math.pi)) ** 2
    measured = float(_sphere(radar, ka, along_axis=True)[0])
    name = f"sphere ka = {ka:g} along its mesh's axis of symmetry, physical optics"
    return _row(name, RANGE_M, measured * area, float(exact.sphere_optics(ka)) * area)


def _still(vertices: np.ndarray, faces: np.ndarray, radar: Radar) -> np.ndarray:
    mesh = MovingMesh(np.stack([vertices, vertices]), faces, TIMES_S, PEC)
    return np.asarray(t2d.simulate(mesh, radar=radar).cube[0, 0])


def _read_sphere(ka: float) -> dict[str, object]:
    """At mid-sweep, from the two middle samples: over a sweep ka changes."""
    radar = Radar.preset("table2-long")
    radius = ka * radar.wavelength_m / (2 * math.pi)
    vertices, faces = sphere(radius, radar.tx_position_m + [RANGE_M + radius, 0, 0])
    middle = _still(vertices, faces, radar)[radar.samples // 2 - 1 : radar.samples // 2 + 1]
    measured = float(np.mean(np.abs(middle) ** 2)) * RANGE_M**4 / radar.link_amplitude**2
    near = (RANGE_M / (RANGE_M + radius)) ** 2
    return _row(f"sphere ka = {ka:g}, Mie", RANGE_M, measured, exact.mie(ka) * math.pi * radius**2 * near)


def _spheroid_tip(radar: Radar) -> float:
    a, c = SPHEROID_M
    unit, faces = sphere(1.0, np.zeros(3))
    shape = on_turntable(unit * [c, a, a], faces, aspects(0, 1, 2), radar.tx_position_m + [FAR_M, 0, 0])
    found = rcs(mesh_fields(shape, radar, occlusion=False)[0, 0], FAR_M)
    return abs(float(db(found / exact.spheroid_tip_rcs(a, c, radar.wavelength_m))))


# --- plates and cylinders ---


def _plate(radar: Radar) -> Pattern:
    angles = aspects(-60, 60, 1201)
    found = _turned(radar, *_rectangle(), angles)
    return Pattern("plate 10 x 10 cm, far away", angles, found, exact.plate_rcs(*PLATE_M, angles, radar.wavelength_m))


def _near_plate(radar: Radar) -> Pattern:
    """At NEAR_M, against Gauss's quadrature of the same integral."""
    angles = aspects(-30, 30, 301)
    node, weight = np.polynomial.legendre.leggauss(200)
    y, z = (node * side / 2 for side in PLATE_M)
    cells = np.stack(np.meshgrid([0.0], y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    areas = np.outer(np.outer(weight, weight).ravel() * math.prod(PLATE_M) / 4, [-1.0, 0, 0])
    place = radar.tx_position_m + [NEAR_M, 0, 0]
    expected = [
        exact.summed_optics(turn.apply(cells) + place, turn.apply(areas), radar.tx_position_m, radar.wavelength_m)
        for turn in Rotation.from_rotvec(np.outer(angles, [0, 0, 1]))
    ]
    found = _turned(radar, *_rectangle(), angles, NEAR_M)
    return Pattern(
        f"plate 10 x 10 cm at {NEAR_M:g} m", angles, found, np.array(expected) * NEAR_M**4, shown_db=NEAR_SHOWN_DB
    )


def _rectangle() -> tuple[np.ndarray, np.ndarray]:
    """Looking along -x."""
    y, z = PLATE_M[0] / 2, PLATE_M[1] / 2
    return np.array([[0, -y, -z], [0, y, -z], [0, y, z], [0, -y, z]]), np.array([[0, 2, 1], [0, 3, 2]])


def _cylinder(radar: Radar) -> Pattern:
    angles = aspects(0, 90, 1801)
    vertices, faces = _closed_cylinder()
    found = _turned(radar, vertices[:, [2, 1, 0]] * [1, 1, -1], faces, angles - math.pi / 2)
    expected = exact.cylinder_rcs(*CYLINDER_M, angles, radar.wavelength_m)
    return Pattern("cylinder 4 x 25 cm, far away", angles, found, expected)


def _closed_cylinder() -> tuple[np.ndarray, np.ndarray]:
    """Along z."""
    import trimesh

    shape = trimesh.creation.cylinder(radius=CYLINDER_M[0], height=CYLINDER_M[1], sections=64)
    return np.asarray(shape.vertices), np.asarray(shape.faces)


def _read_cylinder(range_m: float) -> dict[str, object]:
    """Broadside, against cells of 0.2 mm along a ring of 0.2 degrees."""
    radar = Radar.preset("table2-long")
    radius, length = CYLINDER_M
    vertices, faces = _closed_cylinder()
    place = radar.tx_position_m + [range_m + radius, 0, 0]
    z, angle = np.meshgrid(
        (np.arange(1250) + 0.5) / 1250 * length - length / 2, np.radians(90.1 + 0.2 * np.arange(900)), indexing="ij"
    )
    normal = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1).reshape(-1, 3)
    cells = radius * normal + z.reshape(-1, 1) * [0, 0, 1] + place
    areas = normal * (length / 1250 * math.radians(0.2) * radius)
    expected = exact.summed_optics(cells, areas, radar.tx_position_m, radar.wavelength_m) * range_m**4
    return _row(
        "cylinder, broadside", range_m, read_rcs(_still(vertices + place, faces, radar), radar, range_m), expected
    )


def _turned(
    radar: Radar, vertices: np.ndarray, faces: np.ndarray, angles: np.ndarray, range_m: float = FAR_M
) -> np.ndarray:
    """RCS [m^2] over the turntable's angles, nothing hidden but backs."""
    shape = on_turntable(vertices, faces, angles, radar.tx_position_m + [range_m, 0, 0])
    return rcs(mesh_fields(shape, radar, occlusion=False)[0], range_m)


# --- corners ---


def _dihedral(radar: Radar) -> Pattern:
    """Two square plates with a common vertical edge; at 0 the radar is on the bisector."""
    angles, a, lam = aspects(-45, 45, 1801), CORNER_M, radar.wavelength_m
    edge = np.array([[0, 0, -a / 2], [0, 0, a / 2]])
    left, right = (edge + [a / math.sqrt(2), sign * a / math.sqrt(2), 0] for sign in (1, -1))
    vertices = np.concatenate([edge, left, right])
    faces = np.array([[0, 2, 3], [0, 3, 1], [0, 5, 4], [0, 1, 5]])
    # Each plate's own pattern, with the phase of its middle, half an edge's length from the common edge.
    k = 2 * math.pi / lam
    field = np.zeros(len(angles), complex)
    for sign in (1, -1):
        off = angles + sign * math.pi / 4  # from the plate's normal
        lobes = np.cos(off) * np.sinc(k * a * np.sin(off) / math.pi)
        field += lobes * np.exp(-1j * sign * k * a * np.sin(off))
    optics = 4 * math.pi * (a * a / lam) ** 2 * np.abs(field) ** 2
    truth = 16 * math.pi * (a * a / lam) ** 2 * np.sin(math.pi / 4 - np.abs(angles)) ** 2
    found = _turned(radar, vertices @ _half_turn().T, faces, angles)
    return Pattern("dihedral of 10 cm plates, far away", angles, found, optics, truth)


def _half_turn() -> np.ndarray:
    """The targets' own +x looks at the radar, which stands at -x of them."""
    return np.diag([-1.0, -1.0, 1.0])


def _trihedral(radar: Radar, *, triangular: bool) -> Pattern:
    """Three plates at right angles, seen over azimuth at the elevation of their axis (1, 1, 1)."""
    angles, a, lam = aspects(-45, 45, 1801), CORNER_M, radar.wavelength_m
    points, faces = [], []
    for i in range(3):
        u, v = np.eye(3)[(i + 1) % 3] * a, np.eye(3)[(i + 2) % 3] * a
        first = 4 * i
        points += [0 * u, u, v, u + v]
        faces += (
            [[first, first + 1, first + 2]]
            if triangular
            else [[first, first + 1, first + 3], [first, first + 3, first + 2]]
        )
    vertices = np.array(points)
    used, inverse = np.unique(np.array(faces), return_inverse=True)
    vertices, triangles = vertices[used], inverse.reshape(-1, 3)
    # The axis (1, 1, 1) becomes the way to the radar, horizontal; the third edge stays in the vertical plane.
    axis = np.ones(3) / math.sqrt(3)
    left = np.array([-1, 1, 0]) / math.sqrt(2)
    frame = np.stack([axis, left, np.cross(axis, left)])
    found = _turned(radar, vertices @ frame.T @ _half_turn().T, triangles, angles)
    peak = (4 / 3 if triangular else 12) * math.pi * a**4 / lam**2
    truth = np.where(np.abs(angles) < 1e-9, peak, 0)
    name = "triangular" if triangular else "square"
    return Pattern(f"{name} trihedral of 10 cm edges, far away", angles, found, truth=truth)


def _room_corner(radar: Radar, walls: int) -> dict[str, object]:
    """The power that comes back from a corner of 2 or 3 endless metal walls, as an RCS: pi R^2, R the way to the corner."""
    away = np.ones(3) if walls == 3 else np.array([1.0, 1.0, 0])
    away *= CORNER_RANGE_M / np.linalg.norm(away)
    surfaces = tuple(_wall(radar.tx_position_m + away, axis) for axis in range(walls))
    mirrors = Mirrors.of(Scene(name="corner", surfaces=surfaces), select("auto"))
    paths = [path for path in static_paths(mirrors, radar, order=walls) if len(path.chain) == walls]
    cube = synthesize(mirror_echoes(paths, radar, times_s=np.linspace(0, 0.02, 5)), radar)
    power = float(np.mean(np.abs(cube[:]) ** 2))
    return _row(
        f"corner of {walls} endless walls of a room", CORNER_RANGE_M,
        power * CORNER_RANGE_M**4 / radar.link_amplitude**2, math.pi * CORNER_RANGE_M**2,
    )  # fmt: skip


def _wall(corner_m: np.ndarray, axis: int, half_m: float = 20.0) -> Surface:
    """A square of walls across an axis, through a point."""
    u, v = (half_m * np.eye(3)[(axis + i) % 3] for i in (1, 2))
    vertices = corner_m + np.array([-u - v, u - v, u + v, v - u])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Surface(name=f"wall {axis}", vertices=vertices, faces=faces, material=PEC, thickness_m=0.01)


# --- report ---


def _note(valid: dict[float, float], width: dict[bool, float], corners: list[Pattern], near: Pattern) -> str:
    missing = ", ".join(f"{p.missing_db:.0f} dB ({p.title})" for p in corners)
    return (
        f"Physical optics stays within 1 dB of the Mie series from ka = {valid[1.0]:.1f} on and within {LIMIT_DB} dB "
        f"from {valid[LIMIT_DB]:.1f}; what is left is the return of the shadow line, which a perfect conductor does "
        f"not have so sharply, and the wave that creeps round. For an endless cylinder it is ka = {width[True]:.1f} "
        f"with the field along the axis and {width[False]:.1f} across. At 77 GHz a body's wrists have ka = "
        f"{BODY_KA[0]} and its chest {BODY_KA[1]}; fingers of 7 mm radius 11. Spheres of facets: default fineness, "
        f"sum of the echoes at mid-sweep, radii of 0.06 mm to 0.3 m at {RANGE_M:g} m, each in a random orientation. "
        "Along an axis of symmetry of a regular mesh the facets' lattice can return lobes that add up, up to 0.5 dB "
        "(table); the float64 sum of the same facets agrees, so it is the mesh's shape and not arithmetic; a body's "
        f"mesh has no such axis. Patterns at {FAR_M / 1e3:g} km: the plate against 4 pi A^2/lambda^2 cos^2 sinc^2, "
        "the cylinder against the exact integral over its side (2 pi a L^2/lambda broadside) and the end that is "
        f"lit. At {NEAR_M:g} m the plate is many facets, whose lattice returns lobes 50 dB below the peak: side "
        f"lobes 28 to 30 dB below it are off by up to {near.worst_to(SHOWN_DB):.1f} dB. Read from the ADC cube: "
        "`simulate` at default settings, `table2-long`. Corners: a mesh returns one bounce. Within "
        f"{NEAR_AXIS_DEG:g} degrees of the axis it lacks {missing} of the closed forms 8 pi a^4/lambda^2, 12 pi "
        "a^4/lambda^2 and 4 pi a^4/(3 lambda^2), or more; what it does return is the single plates' side lobes, "
        "exactly. Multiple bounces inside a target are not modelled: armpits, the crook of an arm and legs side by "
        "side return too little where they form corners. A room's walls are mirrors and do bounce: a corner of two "
        "or three of them returns pi R^2 as image theory asks. Sources: Bohren and Huffman, chapter 4; Bowman, "
        "Senior, Uslenghi, chapters 2 and 10; Knott, Shaeffer, Tuley, chapter 6; Kerr, Propagation of Short Radio "
        "Waves, on corner reflectors."
    )


def _ka_chart(mie: np.ndarray, optics_error: np.ndarray, facets: np.ndarray, facet_error: np.ndarray) -> str:
    figure, (level, error) = new_figure(nrows=2, sharex=True, figsize=(7, 6.5))
    level.semilogx(KA, db(mie), "k-", linewidth=1, label="Mie, exact")
    level.semilogx(KA, db(exact.sphere_optics(KA)), "C0-", linewidth=1, alpha=0.8, label="physical optics, exact")
    level.semilogx(FACET_KA, db(facets.mean(axis=1)), "C1o", markersize=4, label=f"facets, mean of {TURNS} sides")
    level.set(ylabel=r"$\sigma / \pi a^2$ [dB]", ylim=(-32, 8), title="perfectly conducting sphere")
    level.legend(loc="lower right")
    error.loglog(KA, np.abs(optics_error), "C0-", linewidth=0.8, label="physical optics against Mie")
    error.loglog(
        FACET_KA,
        np.abs(facet_error).max(axis=1),
        "C1o",
        markersize=4,
        label="facets against physical optics, worst side",
    )
    for bar in (1.0, LIMIT_DB):
        error.axhline(bar, color="C3", linestyle=":", linewidth=1)
    error.axvspan(*BODY_KA, color="C2", alpha=0.12)
    error.text(
        math.sqrt(BODY_KA[0] * BODY_KA[1]), 14, "wrist to chest\nat 77 GHz", ha="center", va="center", fontsize=8
    )
    error.set(xlabel="ka", ylabel="|error| [dB]", ylim=(2e-5, 40))
    error.legend(loc="lower left", fontsize=8)
    for axis in (level, error):
        axis.grid(alpha=0.3, which="both", linewidth=0.5)
    return save_chart(figure, "canonical_sphere.png")


def _width_chart(error: dict[bool, np.ndarray]) -> str:
    figure, axis = new_figure(figsize=(6.5, 3.6))
    for along, label in ((True, "field along the axis"), (False, "field across")):
        axis.loglog(KA, np.abs(error[along]), linewidth=0.8, label=label)
    axis.axhline(LIMIT_DB, color="C3", linestyle=":", linewidth=1)
    axis.set(
        xlabel="ka",
        ylabel="|error of physical optics| [dB]",
        ylim=(1e-3, 40),
        title="endless conducting cylinder, broadside",
    )
    axis.legend()
    axis.grid(alpha=0.3, which="both", linewidth=0.5)
    return save_chart(figure, "canonical_cylinder_ka.png")


def _pattern_chart(*patterns: Pattern) -> str:
    figure, axes = new_figure(nrows=len(patterns), figsize=(7, 8.5))
    for axis, p in zip(axes, patterns, strict=True):
        axis.plot(p.angle_deg, db(p.optics), "k-", linewidth=1.6, alpha=0.5, label="exact integral")
        axis.plot(p.angle_deg, db(p.facets), "C1-", linewidth=0.6, label="facets, default")
        top = float(db(p.optics.max()))
        axis.set(ylim=(top - 55, top + 6), ylabel="RCS [dBsm]", title=p.name, xlim=(p.angle_deg[0], p.angle_deg[-1]))
        axis.grid(alpha=0.3)
        axis.legend(loc="upper center" if axis is axes[-1] else "upper right", fontsize=8)
    for axis in axes[:2]:
        axis.set_xlabel("off the normal [deg]")
    axes[-1].set_xlabel("off broadside [deg]: 90 sees the end")
    return save_chart(figure, "canonical_patterns.png")


def _corner_chart(patterns: list[Pattern]) -> str:
    figure, axes = new_figure(ncols=len(patterns), figsize=(11, 3.8), sharey=True)
    for axis, p in zip(axes, patterns, strict=True):
        axis.plot(p.angle_deg, db(p.facets), "C1-", linewidth=0.6, label="facets: one bounce")
        truth = p.truth
        many = np.count_nonzero(truth) > 1
        kept = truth > 0
        axis.plot(
            p.angle_deg[kept],
            db(truth[kept]),
            "k-" if many else "k*",
            label="all bounces, closed form" + ("" if many else " (axis)"),
        )
        axis.set(title=p.title, xlabel="off the axis [deg]", ylim=(-80, 30))
        axis.grid(alpha=0.3)
        axis.legend(
            fontsize=7, **({"loc": "lower center"} if many else {"loc": "center", "bbox_to_anchor": (0.5, 0.65)})
        )
    axes[0].set_ylabel("RCS [dBsm]")
    return save_chart(figure, "canonical_corners.png")
