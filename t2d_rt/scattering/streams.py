"""Echo streams of several targets joined into one, and cut into as many as are summed one after another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from t2d_rt.scattering.antennas import side_by_side
from t2d_rt.types import EchoStream, Radar

MOST_ECHOES = 150_000
"""Echoes that are summed together; in a window of frames they take some 1 GB. More of them are summed in several parts."""


def joined(streams: list[EchoStream]) -> EchoStream:
    """Several targets' echoes as one stream; all must have the same frame times."""
    if len(streams) == 1:
        return streams[0]
    return EchoStream(
        times_s=streams[0].times_s,
        frames=lambda start, stop: side_by_side([stream.frames(start, stop) for stream in streams]),
        vertices=max(stream.vertices for stream in streams),
        echoes=sum(stream.echoes for stream in streams),
        at_once=min((stream.at_once for stream in streams if stream.at_once), default=0),
    )


def in_parts(streams: list[EchoStream]) -> EchoStream:
    """The streams joined into one that keeps them in `parts`, so that they can be summed one after another."""
    return streams[0] if len(streams) == 1 else replace(joined(streams), parts=tuple(streams))


def batches(streams: Sequence[EchoStream], radar: Radar) -> list[EchoStream]:
    """Streams, or their parts, of the same frame times joined in order into as few as have at most `most_echoes` each."""
    found: dict[int, list[list[EchoStream]]] = {}
    for stream in streams:
        mine = found.setdefault(len(stream.times_s), [])
        for part in stream.parts or (stream,):
            if not mine or sum(each.echoes for each in mine[-1]) + part.echoes > most_echoes(radar):
                mine.append([])
            mine[-1].append(part)
    return [joined(some) for mine in found.values() for some in mine]


def most_echoes(radar: Radar) -> int:
    """How many echoes are summed together; an array's hold their places, too."""
    return MOST_ECHOES // 2 if radar.is_array else MOST_ECHOES
