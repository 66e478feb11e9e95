"""Threads of BLAS and heaps of malloc in a process of ours."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc, asks glibc")

COUNT = """
import ctypes, sys, threading
from pathlib import Path
from nlens_video.cli.library_defaults import set_library_defaults
set_library_defaults()
import numpy as np
wide = np.ones((600, 600))
wide @ wide
print(len(list(Path("/proc/self/task").iterdir())))
together, held = threading.Barrier(9), []
def allocate():
    together.wait()
    held.append(np.ones(5000))
    together.wait()
threads = [threading.Thread(target=allocate) for _ in range(8)]
for one in threads:
    one.start()
together.wait()
together.wait()
libc = ctypes.CDLL(None)
libc.fopen.restype = ctypes.c_void_p
file = ctypes.c_void_p(libc.fopen(sys.argv[1].encode(), b"w"))
libc.malloc_info(0, file)
libc.fclose(file)
print(Path(sys.argv[1]).read_text().count("<heap nr="))
"""


def threads_and_heaps(folder, **environment):
    kept = {k: v for k, v in os.environ.items() if "OPENBLAS" not in k and "MALLOC" not in k}
    run = subprocess.run(
        [sys.executable, "-c", COUNT, folder / "heaps.xml"],
        env={**kept, **environment}, capture_output=True, text=True, check=True,
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    return tuple(int(word) for word in run.stdout.split())


def test_products_of_matrices_take_one_thread_and_threads_share_one_heap(tmp_path):
    assert threads_and_heaps(tmp_path) == (1, 1)


def test_what_the_environment_says_is_kept(tmp_path):
    threads, heaps = threads_and_heaps(tmp_path, OPENBLAS_NUM_THREADS="2", MALLOC_ARENA_MAX="4")
    assert threads == min(2, os.cpu_count()) and heaps > 2


@pytest.mark.parametrize("given", [{}, {"MALLOC_TRIM_THRESHOLD_": "4096"}])
def test_processes_that_are_started_keep_as_much_of_what_is_free(given):
    kept = {k: v for k, v in os.environ.items() if "MALLOC" not in k}
    print_it = (
        "import os; from nlens_video.cli.library_defaults import set_library_defaults; "
        "set_library_defaults(); "
        "print(os.environ['MALLOC_MMAP_THRESHOLD_'], os.environ['MALLOC_TRIM_THRESHOLD_'])"
    )
    run = subprocess.run(
        [sys.executable, "-c", print_it], env={**kept, **given}, capture_output=True, text=True,
        check=True, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert run.stdout.split() == ["33554432", given.get("MALLOC_TRIM_THRESHOLD_", "33554432")]
