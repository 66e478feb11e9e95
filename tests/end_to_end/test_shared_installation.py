"""A read-only installation of the wheel, used by someone without rights and without a home."""

import os
import shutil
import stat
from contextlib import contextmanager
from pathlib import Path

import pytest
from support import shots
from support.installation import (
    NOBODY,
    build_wheel,
    install,
    open_folder,
    python_for_others,
    read_only,
    run_as_other,
    writable,
)

OTHER = NOBODY if not os.geteuid() else os.geteuid()
NO_HOME = {"HOME": "/nonexistent"}
SHOW_NOTES = "from nlens_video.kernels import numba_config; print(*numba_config.cache_notes())"


@pytest.fixture(scope="module")
def program():
    """The installed command, where its user may read but not write."""
    python = python_for_others()
    if python is None:
        reason = "no Python of this version that other users may run; apt-get install python3"
        if os.environ.get("REQUIRE_ROOT") == "1":
            pytest.fail(f"REQUIRE_ROOT=1, but {reason}", pytrace=False)
        pytest.skip(reason)
    with open_folder() as folder:
        home = folder / "venv"
        install(build_wheel(folder), home, python)
        read_only(home)
        yield home / "bin" / "nlens-video"
        writable(home)


@contextmanager
def open_room():
    with open_folder() as folder:
        (folder / "tmp").mkdir()
        (folder / "tmp").chmod(0o1777)
        yield folder


@pytest.fixture
def room():
    """Where the user works, with a temporary folder of their own."""
    with open_room() as folder:
        yield folder


@pytest.fixture(scope="module")
def work():
    """Files to work with, and one temporary folder for the tests that compile kernels."""
    with open_room() as room:
        shots.write_png(room / "plate.png").chmod(0o644)
        shots.write_video(room / "in.mp4", frames=3).chmod(0o644)
        shots.cube_glb(room / "anim.glb").chmod(0o644)
        shots.fit_json(room / "fit.json").chmod(0o644)
        yield room


def test_main_command_runs_with_one_note_if_no_cache_folder_is_writable(program, work):
    room = work
    environment = {**NO_HOME, "TMPDIR": str(room / "tmp")}
    command = (
        program, "plate.png", "anim.glb", "out.png", "--fit", "fit.json", "--preset", "draft",
        "--effects", "defocus",
    )  # fmt: skip
    run = run_as_other(*command, cwd=room, environment=environment)
    assert run.returncode == 0, run.stderr
    cache = room / "tmp" / f"nlens-video-{OTHER}"
    notes = [line for line in run.stderr.splitlines() if "kernels" in line]
    assert len(notes) == 1 and f"kernels are cached in {cache}" in notes[0]
    assert "Traceback" not in run.stderr
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700 and cache.stat().st_uid == OTHER
    assert list(cache.rglob("*.nbc"))
    assert (room / "out.png").is_file()

    doctor = run_as_other(program, "doctor", "--json", cwd=room, environment=environment)
    assert doctor.returncode == 0, doctor.stdout + doctor.stderr
    assert f"cached in {cache}" in doctor.stdout


def test_farm_runs_without_a_home_folder(program, work):
    run = run_as_other(
        program, "farm", "in.mp4", "anim.glb", "out.mp4", "--fit", "fit.json", "--preset", "draft",
        "--effects", "defocus", cwd=work, environment={**NO_HOME, "TMPDIR": str(work / "tmp")},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert (work / "out.mp4").is_file()


@pytest.mark.needs_root
def test_user_without_a_passwd_entry_creates_no_folder_named_tilde(program, room):
    environment = {"TMPDIR": str(room / "tmp")}
    run = run_as_other(
        program.with_name("python"), "-c", SHOW_NOTES, cwd=room, environment=environment, uid=54321
    )
    assert f"cached in {room / 'tmp' / 'nlens-video-54321'}" in run.stdout, run.stderr
    assert [path.name for path in room.iterdir()] == ["tmp"]


@pytest.mark.parametrize("trap", ["open to all", "a link"])
def test_kernel_cache_writable_by_others_is_not_loaded(program, room, trap):
    folder = room / "tmp" / f"nlens-video-{OTHER}"
    if trap == "a link":
        (room / "elsewhere").mkdir(mode=0o700)
        folder.symlink_to(room / "elsewhere")
    else:
        folder.mkdir()
        folder.chmod(0o777)
    before = {path for path in others_places() if path.exists()}
    environment = {**NO_HOME, "TMPDIR": str(room / "tmp")}
    run = run_as_other(
        program.with_name("python"), "-c", SHOW_NOTES, cwd=room, environment=environment
    )
    assert run.returncode == 0 and "kernels are" in run.stdout, run.stderr
    assert str(folder) not in run.stdout
    for path in set(others_places()) - before:
        shutil.rmtree(path, ignore_errors=True)


def others_places():
    return [Path(name) / f"nlens-video-{OTHER}" for name in ("/var/tmp", "/dev/shm")]


@pytest.mark.needs_root
@pytest.mark.needs_mount
def test_kernels_are_compiled_each_run_if_nothing_is_writable(program):
    mounts = (
        "mount -t tmpfs -o ro none /var/tmp && mount -t tmpfs -o ro none /dev/shm && "
        "mount --bind /tmp /tmp && mount -o remount,bind,ro /tmp && cd / && "
        f"exec setpriv --reuid={NOBODY} --regid={NOBODY} --clear-groups "
        f"{program.with_name('python')} -c "
        f"'{SHOW_NOTES}; from nlens_video.kernels.scatter.disc import *'"
    )
    run = run_as_other(
        "unshare", "-m", "sh", "-c", mounts, cwd=Path("/"), environment=NO_HOME, uid=0
    )
    assert run.returncode == 0, run.stderr
    assert "kernels are not cached" in run.stdout
