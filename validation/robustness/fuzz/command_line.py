"""Words on the command line: every option with odd values, unknown ones, names of files, --add, config files."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import t2d_rt as t2d
from validation.robustness.fuzz.case import (
    MOTIONS,
    Attempt,
    chance,
    check_picture,
    check_recording,
    command,
    leaving_nothing,
    pick,
)

WORDS = (
    "", " ", "nan", "inf", "-inf", "1e300", "-1", "0", "-0", "1e-300", "1e400", "1_000", "0x10", "10" * 200, "true", "null",
    "None", "~", "[]", "{}",
    "[1]", "[1, 2]", "[1,2,3]", "[2, 1]", "[nan, 1]", "[[1]]", "{a: 1}", "{1: 2}", "'x", "\"x\"", "x", "auto", "mean", "none",
    "mesh", "ellipsoid", "3",
    "2.5", "64", "1e3", "a b", "a\nb", "\x1b[31mred", "\x9b31m", "\u202e", "naïve", "日本", "a\udcff", "$x$", "$HOME", "%s",
    "{name}", "!!python/name:os.system",
    "*a", "&a [*a]", "@x", "--seed", "-o", "=", "a=b", ":", "../..", "/dev/zero", "/dev/full", "y" * 20000, "1" * 5000,
    "[" * 5000, "٣", "1e9",
    "1000000000", "99999999999999999999", "skin", "pec", "concrete", "free_space", "corridor", "table2", "gpu", "cpu", "stop",
    "128.0", "-5",
)  # fmt: skip
MILD = (
    "0", "1", "2", "3", "0.1", "0.5", "1.5", "10", "-10", "64", "128", "300", "true", "false", "null", "none", "mean", "[1, 3]",
    "[1, 0, 0]", "[0, 0, 1]", "0.01",
)  # fmt: skip
"""Values that many options take."""
NO_TOLERANCE = ("nan", "inf", "-inf", "1e300", "-1e300", "", "x", "[]", "true", "-300", "300", "null", "1e400")
NAMES = (
    "a b.zarr", "a\nb.zarr", "\x1b[31m.zarr", "$x$.zarr", "$.zarr", "${x}^_{.zarr", "%s.zarr", "日本.zarr", "a\udcff.zarr",
    "a" * 250 + ".zarr", "-x.zarr",
    ".zarr", "..zarr", "x.ZARR", "x.zarr/", "no/such/x.zarr", "walk.bvh", "x.png", "../x.zarr", "/dev/null", "/proc/x.zarr",
    "x.zarr.zarr", "\\x.zarr", "\u202ex.zarr",
    "$x^_{$.zarr", "taken.zarr", "folder.zarr", "link.zarr", "", "~/x.zarr", "file:///x.zarr", "s3://x/y.zarr",
    "memory://x.zarr", "x\0.zarr", "{x}.zarr", "#x.zarr", "a\tb.zarr",
)  # fmt: skip
ADDED = (
    "fan:2,1,1", "fan:2,1,1,rpm=300", "fan:2,1", "fan:", "fan", ":", "fan:2,1,1,rpm=nan", "fan:2,1,1,rpm=1e300",
    "fan:nan,1,1", "fan:2,1,1,radius_m=20",
    "fan:2,1,1,blades=12", "fan:2,1,1,blades=1e9", "fan:2,1,1,radius_m=1e-9", "fan:1e6,1,1", "fan:0,0,1", "ceiling_fan:2,0,2",
    "ceiling_fan:2,0,2,chord_m=20",
    "curtain:3,0,0", "curtain:3,0,0,fold_m=0.021,width_m=20", "curtain:3,0,0,wavelength_m=1e-300", "curtain:3,0,0,seed=-1",
    "curtain:3,0,0,seed=1e30",
    "curtain:3,0,0,width_m=1e-300", "door:3,0,0", "door:3,0,0,period_s=none", "door:3,0,0,opens_at_s=1e300",
    "door:3,0,0,opening_s=1e-300", "door:3,0,0,thickness_m=1e-300",
    "pet:3,0,0", "pet:3,0,0,animal=cat", "pet:3,0,0,animal=cow", "pet:3,0,0,size=3,speed_mps=5",
    "pet:3,0,0,turn_radius_m=1e-300", "pet:3,0,0,turn_radius_m=none",
    "pet:3,0,0,speed_mps=1e-300", "person:walk.bvh", "person:my, walk.bvh", "person:none.bvh", "person:",
    "person:walk.bvh,distance_m=3", "person:walk.bvh,distance_m=nan",
    "person:walk.bvh,distance_m=1e9", "person:walk.bvh,stop_s=0", "person:walk.bvh,start_s=-1",
    "person:walk.bvh,file=walk.bvh", "person:walk.bvh,angle_deg=1e300",
    "fan:2,1,1,material=skin", "fan:2,1,1,material=", "fan:2,1,1,material=no such", "fan:2,1,1,material={a: 1}",
    "fan:2,1,1,x=1", "fan:2,1,1,rpm=1,rpm=2", "fan:2,1,1,=3",
    "fan:2,1,1,rpm", "fan:2,1,1,kind=pet", "{kind: fan, position_m: [2, 1, 1]}", "{kind: fan}", "null", "[]",
    "fan:2,1,1\x1b[31m", "fam:2,1,1", "fan:٢,1,1",
    "fan:2,1,1," + "x" * 20000, "fan:" + "1," * 5000, "fan:2;1;1", "fan: 2, 1, 1, rpm = 300", "FAN:2,1,1",
    "fan:2,1,1,position_m=3", "fan:2,1,1,rpm=[1]", "fan:2,1,1,rpm=true",
)  # fmt: skip
CONFIGS = (
    "add: null", "add: []", "add: fan:2,1,1", "add: [fan:2,1,1]", "add: [null]", "add: [3]",
    "add: [{kind: fan, position_m: [2, 1, 1]}]", "add: [{kind: null}]",
    "add: [{kind: [fan]}]", "add: [[fan]]", "add: {kind: fan}", "add: [{kind: fan, position_m: &a [*a]}]",
    "add: [{kind: person, file: null}]", "add: [{1: 2}]",
    "radar: null", "radar: ci4r", "radar: 3", "radar: []", "radar: [ci4r]", "radar: {}", "radar: {samples: null}",
    "radar: {position_m: 3}", "radar: {tx_pattern: 3}",
    "radar: {tx_pattern: {kind: table}}", "radar: {tx_pattern: &a {a: *a}}", "radar: no such", "radar: {1: 2}",
    "radar.samples: 16", "radar: '\\x1b[31m'",
    "signal: null", "signal: {n_window: null}", "signal: {kernel: []}", "signal: {kernel: [.nan]}", "signal: {kernel: x}",
    "signal: {range_gate_m: [1]}", "signal: {mti: no}",
    "motion: null", "motion: {units: []}", "motion: {floor: .nan}", "motion: {up: no}", "motion: {smooth_hz: true}",
    "motion: {flavour: 3}", "seed: null", "seed: 1.5",
    "seed: 1e3", "seed: '3'", "seed: [3]", "seed: &a [*a]", "file: null", "file: 3", "file: [walk.bvh]", "file: walk.bvh",
    "output: 3", "output: null", "overwrite: null",
    "overwrite: 3", "config: my.yaml", "help: true", "print_config: true", "scene: null", "scene: 3", "scene: [corridor]",
    "scene: ''", "collisions: no", "clutter: none",
    "clutter: null", "method: null", "method: 3", "body: null", "material: {}", "material: 3", "tolerance_db: null",
    "tolerance_db: 5000", "stop_s: .inf", "stop_s: null",
    "start_s: -1", "distance_m: 1e9", "angle_deg: .nan", "device: null", "accuracy: {occlusion: null}",
    "accuracy: 3", "accuracy: {tiers: []}", "1: 2", "? [a]\n: 1",
    "seed: 3\nseed: 4", "--seed: 3", "SEED: 3", "x: 1", "", "3",
    "- 1", "a: [", "\t", "!!python/object/apply:os.system ['touch pwned']", "seed: !!python/name:os.system ''",
    "'\\x1b[31m': 1", '"\\e[31m": 1', "null: 1", "true: 1",
    "radar: &r {samples: 32}\nsignal: *r", "seed: 0x10", "seed: 0o17", "seed: 1_0", "seed: 1:30",
    "motion: {units: 2001-01-01}", "radar: {boresight: [0, 0, 0]}",
)  # fmt: skip
QUICK = {
    "method": "ellipsoid", "radar": "ci4r", "radar.samples": "32", "radar.prf_hz": "2000", "stop_s": "0.2",
    "signal.n_window": "64",
}  # fmt: skip
"""Options of a short run."""
COARSE: dict[str, dict[str, str]] = {
    "simulate": {}, "plan": {}, "scene": {"reflections": "1"}, "compare": {"accuracy.sagitta_rad": "2", "stop_s": "0.1"},
}  # fmt: skip
"""More of them for some commands."""


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One command line."""
    (folder / "walk.bvh").write_bytes((MOTIONS / "momask_22j_120frames.bvh").read_bytes())
    words = pick(rng, (_options, _options, _options, _named, _added, _configured, _words, _files))(rng, folder)
    words = [word.replace("\0", "") for word in words]  # the system hands none over
    ascii_only = chance(rng, 0.1)
    act = leaving_nothing(command(words, ascii_only=ascii_only), folder)
    told = "t2d-rt " + " ".join(
        repr(word) if not word.isprintable() or not word or " " in word else word for word in words
    )
    return Attempt(f"{told[:400]}{' (ASCII)' if ascii_only else ''}", lambda: _written(act, folder, words))


def _command(rng: np.random.Generator) -> str:
    return pick(rng, ("simulate", "simulate", "simulate", "plan", "compare", "scene"))


def _options(rng: np.random.Generator, _: Path) -> list[str]:
    """One or two options with odd values."""
    name = _command(rng)
    options = _all_options(name)
    given = _quick(name)
    for _ in range(int(rng.integers(1, 3))):
        option = pick(rng, options)
        # a tolerance that can be kept takes minutes to plan
        given[option] = pick(rng, NO_TOLERANCE if option == "tolerance_db" else WORDS if chance(rng, 0.6) else MILD)
    return [*_head(name), *_spelled(rng, given)]


def _all_options(name: str) -> list[str]:
    """Every option of a command, as its help names them."""
    from t2d_rt.cli import _command as command

    text = command(name).parser.format_help()
    found = [
        option.replace("-", "_")
        for option in re.findall(r"^\s+(?:-\w(?: \w+)?, )?--([\w.-]+)", text, flags=re.MULTILINE)
    ]
    return sorted({*found, *(("radar",) if name != "info" else ())} - {"help", "config", "print_config", "file", "add"})


def _quick(name: str) -> dict[str, str]:
    """Options that make a command's run short."""
    known = set(_all_options(name))
    return {key: value for key, value in (QUICK | COARSE[name]).items() if key in known or key == "radar"}


def _head(name: str) -> list[str]:
    """The command and its file. A plan takes as long as it takes: its options are only read."""
    return [name, "empty_room" if name == "scene" else "walk.bvh", *(["--print_config"] if name == "plan" else [])]


def _spelled(rng: np.random.Generator, given: dict[str, str]) -> list[str]:
    """--name value, --name=value, with - or _."""
    words = []
    for name, value in given.items():
        spelled = name.replace("_", "-") if chance(rng, 0.5) else name
        words += [f"--{spelled}={value}"] if chance(rng, 0.5) else [f"--{spelled}", value]
    return words


def _named(rng: np.random.Generator, folder: Path) -> list[str]:
    """Names of results and pictures."""
    name = _command(rng)
    (folder / "folder.zarr").mkdir()
    (folder / "taken.zarr").write_text("mine")
    (folder / "link.zarr").symlink_to("walk.bvh")
    output = pick(rng, NAMES)
    if name in ("compare", "scene") and chance(rng, 0.7):
        output = output.replace(".zarr", pick(rng, (".png", ".pdf", ".svg", ".PNG", ".jpg", "")))
    over = ["--overwrite"] if chance(rng, 0.5) else []
    return [*_head(name), *_spelled(rng, _quick(name)), "-o", output, *over]


def _added(rng: np.random.Generator, _: Path) -> list[str]:
    """What moves beside the walker. With the mesh method a fan turns, with ellipsoids it is refused: both are tried."""
    added = [word for _ in range(int(rng.integers(1, 3))) for word in ("--add", pick(rng, ADDED))]
    given = _quick("simulate") | (
        {"method": "mesh", "stop_s": "0.05", "accuracy.sagitta_rad": "2"} if chance(rng, 0.4) else {}
    )
    return [*_head("simulate"), *_spelled(rng, given), *added]


def _configured(rng: np.random.Generator, folder: Path) -> list[str]:
    """A config file."""
    name = pick(rng, ("simulate", "simulate", "plan", "compare"))
    values: dict[str, Any] = {"method": "ellipsoid", "stop_s": 0.2, "radar": {"samples": 32, "prf_hz": 2000}}
    if name == "compare":
        del values["method"]
    text = yaml.safe_dump({key: value for key, value in values.items() if chance(rng, 0.9)}) if chance(rng, 0.8) else ""
    extra = [pick(rng, CONFIGS) for _ in range(int(rng.integers(1, 3)))]
    (folder / "my.yaml").write_text("\n".join([text.strip(), *extra, ""]).lstrip("\n"))
    more = _spelled(rng, _quick(name)) if chance(rng, 0.6) else ["--stop-s", "0.2"]
    return [
        *_head(name),
        "--config",
        pick(rng, ("my.yaml", "my.yaml", "my.yaml", "my.yaml", "none.yaml", ".", "/dev/zero", "walk.bvh", "")),
        *more,
    ]


def _words(rng: np.random.Generator, _: Path) -> list[str]:
    """Any words in any order."""
    known = [f"--{name}" for name in (*_all_options("simulate"), *inspect.signature(t2d.simulate).parameters)]
    pool = [
        *WORDS,
        *NAMES,
        *known,
        "simulate",
        "plan",
        "info",
        "walk.bvh",
        "--help",
        "-h",
        "--version",
        "--print_config",
        "--overwrite",
        "--add",
        "-",
        "--",
        "-x",
        "--x",
    ]
    chosen = [pick(rng, pool) for _ in range(int(rng.integers(0, 6)))]
    return (
        [
            pick(rng, ("simulate", "info", "plan", "scene", "compare", "", "SIMULATE", "-h", "--version", "simulat")),
            *chosen,
        ]
        if chance(rng, 0.9)
        else chosen
    )


def _files(rng: np.random.Generator, folder: Path) -> list[str]:
    """Files of a wrong kind, or under strange names."""
    name = pick(rng, ("simulate", "plan", "info", "info", "scene", "compare"))
    file = pick(
        rng,
        (
            *NAMES,
            "walk.bvh.gz",
            "x.bvh",
            "/dev/zero",
            ".",
            "/",
            "x.yaml",
            "x.xml",
            "/proc/self/maps",
            "a\nb.bvh",
            "$x$.bvh",
            "a\udcff.bvh",
            "\x1b[31m.bvh",
            "日本.bvh",
            "$x^_{$.bvh",
            "$.bvh",
            "\\frac$$.bvh",
        ),
    )
    file = file.replace("\0", "")
    if file.endswith(".bvh") and "/" not in file and chance(rng, 0.7):
        (folder / file).write_bytes((folder / "walk.bvh").read_bytes())
    return [
        name,
        file,
        *([] if name == "info" else _spelled(rng, _quick(name))),
        *(["--print_config"] if name == "plan" else []),
    ]


def _written(act: Any, folder: Path, words: list[str]) -> None:
    """What a command says it has written is there and whole."""
    printed = act()
    for picture in folder.rglob("*.png"):
        check_picture(picture)
    left = [path.name for path in folder.iterdir() if ".partial" in path.name or ".replaced" in path.name]
    assert not left, f"left behind: {left}"
    if words and words[0] == "simulate" and "wrote " in printed:
        for path in folder.glob("*.zarr"):
            if path.is_dir() and (path / "zarr.json").exists():
                check_recording(t2d.Recording.load(path))
