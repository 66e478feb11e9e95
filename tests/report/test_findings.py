"""Evenly picked frames and timing bins: bounded in number, without loss of time."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlens_video.graph.base.profiler import FrameTiming
from nlens_video.report.findings import EvenPick, TimingBins


def picked(frames, room=24, count=12):
    pick = EvenPick(room=room)
    for index in range(frames):
        if pick.next_is_wanted():
            pick.keep(index)
    return pick.picked(count)


@given(st.integers(1, 3000))
def test_picked_frames_are_few_and_evenly_spread(frames):
    chosen = picked(frames)
    assert len(chosen) == min(frames, 12)
    assert chosen[0] == 0
    if frames > 12:
        gaps = [b - a for a, b in zip(chosen, chosen[1:], strict=False)]
        assert max(gaps) <= 2 * min(gaps)
        assert frames - 1 - chosen[-1] < max(gaps)


def test_number_of_kept_frames_is_bounded_for_a_long_stream():
    pick = EvenPick(room=24)
    kept = 0
    for index in range(100_000):
        if pick.next_is_wanted():
            pick.keep(index)
            kept += 1
    assert kept < 24 + 12 * 13  # twelve for each doubling of the length


@given(st.integers(1, 400), st.sampled_from([2, 8, 64]))
def test_number_of_bins_is_bounded_and_total_time_is_kept(frames, room):
    bins = TimingBins(room=room)
    for index in range(frames):
        nodes = {"render": float(index % 7), f"odd-{index % 2}": 1.0}
        bins.add(FrameTiming(index=index, pts=index, nodes=nodes))
    assert len(bins.bins) <= room
    assert sum(b.frames for b in bins.bins) == frames
    assert [b.first for b in bins.bins] == list(range(0, frames, bins.width))
    spent = sum(sum(b.total_ms.values()) for b in bins.bins)
    assert spent == pytest.approx(sum(index % 7 + 1.0 for index in range(frames)))


def test_bin_holds_the_mean_of_its_frames_and_the_slowest():
    bins = TimingBins(room=2)
    for index, elapsed_ms in enumerate((10.0, 30.0, 20.0)):
        bins.add(FrameTiming(index=index, pts=index, nodes={"render": elapsed_ms}))
    assert bins.width == 2
    assert bins.bins[0].mean_ms("render") == 20.0
    assert bins.bins[0].mean_ms("absent") == 0.0
