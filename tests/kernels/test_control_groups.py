"""Limits of a container, in files as Linux's control groups write them."""

import os

import pytest

from nlens_video.kernels.control_groups import memory_limit, processor_quota
from nlens_video.kernels.thread_pool import processors


def group(folder, files):
    """A control group's folder with files of these names and texts."""
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("100000 100000\n", 1), ("150000 100000\n", 2), ("10000 100000\n", 1),
        ("800000 100000\n", 8), ("25000 50000\n", 1), ("max 100000\n", None), ("", None),
    ],
)  # fmt: skip
def test_quota_of_version_2_is_rounded_up_to_whole_processors(tmp_path, text, count):
    assert processor_quota(group(tmp_path, {"cpu.max": text})) == count


@pytest.mark.parametrize(
    ("quota", "count"), [("200000\n", 2), ("250000\n", 3), ("1000\n", 1), ("-1\n", None)]
)
def test_quota_of_version_1_is_rounded_up_to_whole_processors(tmp_path, quota, count):
    files = {"cpu/cpu.cfs_quota_us": quota, "cpu/cpu.cfs_period_us": "100000\n"}
    assert processor_quota(group(tmp_path, files)) == count


def test_without_control_groups_nothing_is_limited(tmp_path):
    assert processor_quota(tmp_path) is None
    assert memory_limit(tmp_path) is None


@pytest.mark.parametrize("name", ["memory.max", "memory/memory.limit_in_bytes"])
def test_memory_limit_is_read_from_either_version(tmp_path, name):
    assert memory_limit(group(tmp_path / "limited", {name: "536870912\n"})) == 1 << 29
    assert memory_limit(group(tmp_path / "free", {name: "max\n"})) is None


def test_pool_has_no_more_threads_than_the_quota_nor_than_the_processors(tmp_path):
    bound = processors(tmp_path / "free")
    assert processors(group(tmp_path / "one", {"cpu.max": "50000 100000\n"})) == 1
    wide = f"{(bound + 4) * 100000} 100000\n"
    assert processors(group(tmp_path / "wide", {"cpu.max": wide})) == bound
    assert bound <= (os.cpu_count() or 1)
