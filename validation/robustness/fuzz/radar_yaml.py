"""Radar files and config files: values of every type in every field, aliases, tags, doubled keys, depth, size, encodings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

import t2d_rt as t2d
from t2d_rt.types.radar import preset_names
from validation.robustness.fuzz.case import (
    MOTIONS,
    Attempt,
    Wrong,
    chance,
    check_finite,
    check_recording,
    command,
    corrupted,
    leaving_nothing,
    no_raw_warnings,
    pick,
    quick_walk,
)

VALUES = (
    ".nan", ".inf", "-.inf", "1e400", "-1", "0", "-0.0", "1e-320", "1e300", "10000000000000000000000000000000000000000", "77",
    "1e18",
    "0x7fffffff", "0o17", "1:30", "yes", "on", "true", "~", "null", "''", "'12'", "'nan'", "'1e9'", "77 GHz", "77.18e+9",
    "2001-01-01",
    "2001-01-01 10:00:00", "[1, 2]", "[1, 2, 3]", "[[1, 2, 3], [4, 5, 6]]", "[[1, 2], [3]]", "[]", "{}", "{a: 1}", "{1: 2}",
    "[.nan, 0, 0]", "[1e9, 0, 0]", '"\\e[31m"', '"\\x85"', '"\\0"', "!!binary aGVsbG8=", "!!set {a, b}", "!!omap [a: 1]",
    "!!float '1e5'",
    "!!int '0b101'", "!!str 5", "!!timestamp 2001-01-01", "!!python/object/apply:os.system ['touch pwned']",
    "!!python/name:os.system", "!!python/tuple [1, 2]", "!unknown x", "*nothing", "&a [*a]", "&a {b: *a}", "tdm", "ddm",
    "simultaneous", "TDM",
    "{kind: cosine}", "{kind: cosine, exponent: 2}", "{kind: cosine, exponent: .nan}",
    "{kind: cosine, half_power_beamwidth_deg: 179.999999}",
    "{kind: table}", "{kind: table, azimuth_deg: [-1, 1], elevation_deg: [-1, 1], gain_db: [[0, 0], [0, 0]]}",
    "{kind: table, azimuth_deg: [1, -1], elevation_deg: [-1, 1], gain_db: [[0, 0], [0]]}", "{kind: [cosine]}",
    "{kind: &a [*a]}",
    "{kind: \"\\e[31m\"}", "[[0, 0, 0], [0, 0, 0]]", "1", "2", "3", "0.5", "1e6", "2.5", "256", "1000000",
)  # fmt: skip


def attempt(rng: np.random.Generator, folder: Path) -> Attempt:
    """One YAML file and what reads it."""
    told, data, expected = pick(rng, (_fields, _fields, _fields, _text, _large, _damaged))(rng)
    path = folder / "my.yaml"
    path.write_bytes(data)
    return _used(rng, told, path, expected)


def _base(rng: np.random.Generator) -> dict[str, str]:
    radar = t2d.Radar.preset(pick(rng, preset_names()))
    return {name: yaml.safe_dump(value, default_flow_style=True, width=10**6).removesuffix("...\n").strip()
            for name, value in radar.model_dump(mode="json").items()}  # fmt: skip


def _written(fields: dict[str, str]) -> bytes:
    return "".join(f"{name}: {value}\n" for name, value in fields.items()).encode()


def _fields(rng: np.random.Generator) -> tuple[str, bytes, str]:
    fields, told = _base(rng), []
    for _ in range(int(rng.integers(1, 4))):
        name = pick(rng, sorted(fields))
        fields[name] = pick(rng, VALUES)
        told.append(f"{name}: {fields[name]}")
    if chance(rng, 0.2):
        name = pick(
            rng,
            (
                "carier_hz",
                "",
                "? [a, b]",
                "1",
                "~",
                "<<",
                "'a\\e'",
                "position_m.x",
                "model_config",
                "__class__",
                "x" * 5000,
                "naïve",
            ),
        )
        fields[name] = pick(rng, VALUES)
        told.append(f"{name[:40]}: {fields[name]}")
    if chance(rng, 0.2):
        name = pick(rng, sorted(fields))
        del fields[name]
        told.append(f"no {name}")
    return "; ".join(told), _written(fields), ""


def _text(rng: np.random.Generator) -> tuple[str, bytes, str]:
    """The document's own structure."""
    fields = _base(rng)
    data = _written(fields)
    name = pick(rng, sorted(fields))
    cases = (
        ("a key twice", data + f"{name}: {fields[name]}\n".encode(), "refused"),
        ("a key twice, another value", f"{name}: 3\n".encode() + data, "refused"),
        ("two documents", data + b"---\n" + data, "refused"),
        ("a list", b"- " + data.replace(b"\n", b"\n  "), "refused"),
        ("a scalar", b"77\n", "refused"),
        ("nothing", pick(rng, (b"", b"\n", b"---\n", b"...\n", b"# only words\n")), "refused"),
        ("a tab", data.replace(b": ", b":\t", 1), ""),
        ("a tab before", b"\t" + data, "refused"),
        ("a directive", b"%YAML 9.9\n---\n" + data, ""),
        ("UTF-16", data.decode().encode("utf-16"), ""),
        ("not UTF-8", data + b"# \xff\xfe\n", "refused"),
        ("a zero", data + b"\0", "refused"),
        ("a merge", b"a: &a {prf_hz: 1}\n<<: *a\n" + data, ""),
        ("keys of numbers", b"1: 2\n" + data, "refused"),
        ("a key of lists", b"? [a, b]\n: 1\n" + data, "refused"),
        ("terminal escapes", b'"\\e]0;x\\a": 1\n' + data, "refused"),
        ("an error beside an escape", data + b"x: [\x1b[31m\n", "refused"),
        ("flow", b"{" + data.strip().replace(b"\n", b", ") + b"}", ""),
        ("a tag on all", b"!!python/object:t2d_rt.types.Radar\n" + data, "refused"),
        ("an anchor on all", b"&a\n" + data, ""),
    )  # fmt: skip
    return pick(rng, cases)


def _large(rng: np.random.Generator) -> tuple[str, bytes, str]:
    count = int(10 ** rng.uniform(2, 5))
    laughs = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
        f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
    )
    data = _written(_base(rng))
    cases = (
        ("aliases of aliases", laughs.encode() + data),
        ("aliases of aliases in a field", laughs.encode() + data.replace(b"position_m:", b"position_m: *a11\nunknown:")),
        ("aliases of aliases in a pattern", laughs.encode() + data + b"tx_pattern: {kind: *a11}\n"),
        (f"depth {count}", data + b"x: " + b"[" * count + b"]" * count),
        (f"depth {count} of maps", data + b"x: " + b"{a: " * count + b"}" * count),
        (f"{count} keys", data + b"".join(b"k%d: 1\n" % i for i in range(count))),
        (f"{count} offsets", data.replace(b"rx_offsets_m:", b"rx_offsets_m: [" + b"[0, 0, 0], " * count + b"]\nunknown:")),
        (f"a text of {10 * count}", data + b"x: '" + b"y" * 10 * count + b"'"),
        (f"a number of {count} digits", data.replace(b"samples: ", b"samples: " + b"9" * count)),
        (f"{count} blank lines", b"\n" * count + data),
        (f"{count} documents", b"--- {}\n" * count),
        (f"{count} anchors", data + b"x: [" + b"".join(b"&b%d 1, " % i for i in range(count)) + b"]"),
        (f"an indentation of {count}", data + b"x:\n" + b" " * count + b"y: 1\n"),
    )  # fmt: skip
    return (*pick(rng, cases), "")


def _damaged(rng: np.random.Generator) -> tuple[str, bytes, str]:
    told, data = corrupted(rng, _written(_base(rng)))
    return told, data, ""


# --- what is done with it -------------------------------------------------------------------------------------------


def _used(rng: np.random.Generator, told: str, path: Path, expected: str) -> Attempt:
    use = pick(rng, ("load", "load", "info", "radar", "config", "simulate"))
    if use == "info":
        return Attempt(f"{told}: t2d-rt info my.yaml", _expecting(expected, command(["info", "my.yaml"])))
    if use in ("radar", "config"):
        if use == "config":
            path.write_bytes(
                b"radar:\n" + b"".join(b"  " + line for line in path.read_bytes().splitlines(keepends=True))
            )
        # what is printed is the options as they were read: no run, whose length would be the radar's
        words = ["simulate", str(MOTIONS / "12_01_walk.bvh"), f"--{use}", "my.yaml", "--print_config"]
        return Attempt(f"{told}: t2d-rt {' '.join(words)}", leaving_nothing(command(words), path.parent))
    if use == "simulate":
        return Attempt(
            f"{told}: simulate(..., radar=Radar.from_yaml('my.yaml'))", _expecting(expected, lambda: _simulated(path))
        )
    return Attempt(f"{told}: Radar.from_yaml('my.yaml')", _expecting(expected, lambda: _loaded(path)))


def _expecting(expected: str, act: Callable[[], object]) -> Callable[[], None]:
    def checked() -> None:
        act()
        if Path("pwned").exists():
            raise Wrong("a command in the file was executed")
        if expected == "refused":
            raise Wrong("accepted, although it is no radar file or ambiguous")

    return checked


def _loaded(path: Path) -> t2d.Radar:
    radar = t2d.Radar.from_yaml(path)
    radar.to_yaml(path.with_name("again.yaml"))
    if t2d.Radar.from_yaml(path.with_name("again.yaml")) != radar:
        raise Wrong("written and read again it is another radar")
    for name in (
        "bandwidth_hz",
        "wavelength_m",
        "max_range_m",
        "max_speed_mps",
        "range_resolution_m",
        "mid_frequency_hz",
    ):
        check_finite(getattr(radar, name), name)
    check_finite(radar.received_power_w(1.0, 3.0), "received power")
    return radar


def _simulated(path: Path) -> None:
    radar = _loaded(path)
    walk = quick_walk()
    chirps = radar.prf_hz * walk.duration_s
    antennas = len(radar.tx_offsets_m) * len(radar.rx_offsets_m)
    if chirps * antennas * radar.samples > 3e6:
        return  # as long as it says
    with no_raw_warnings():
        check_recording(t2d.simulate(walk, radar=radar, method="ellipsoid"))
