"""A read-only installation of the wheel, used by someone without rights and without a home."""

import os
from contextlib import contextmanager

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
    """Files to work with, and a temporary folder."""
    with open_room() as room:
        shots.write_png(room / "plate.png").chmod(0o644)
        shots.write_video(room / "in.mp4", frames=3).chmod(0o644)
        shots.cube_glb(room / "anim.glb").chmod(0o644)
        shots.fit_json(room / "fit.json").chmod(0o644)
        yield room


def test_main_command_runs_without_a_home_and_leaves_nothing_but_its_result(program, work):
    room = work
    before = {path.name for path in room.iterdir()}
    environment = {**NO_HOME, "TMPDIR": str(room / "tmp")}
    command = (
        program, "plate.png", "anim.glb", "out.png", "--fit", "fit.json", "--preset", "draft",
        "--effects", "defocus",
    )  # fmt: skip
    run = run_as_other(*command, cwd=room, environment=environment)
    assert run.returncode == 0, run.stderr
    assert "Traceback" not in run.stderr
    assert {path.name for path in room.iterdir()} == before | {"out.png"}
    assert not list((room / "tmp").iterdir())

    doctor = run_as_other(program, "doctor", "--json", cwd=room, environment=environment)
    assert doctor.returncode == 0, doctor.stdout + doctor.stderr


def test_farm_runs_without_a_home_folder(program, work):
    run = run_as_other(
        program, "farm", "in.mp4", "anim.glb", "out.mp4", "--fit", "fit.json", "--preset", "draft",
        "--effects", "defocus", cwd=work, environment={**NO_HOME, "TMPDIR": str(work / "tmp")},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert (work / "out.mp4").is_file()
