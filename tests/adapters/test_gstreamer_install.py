"""The element is installed where GStreamer looked before, and belongs to the pipelines it is in."""

import subprocess
import sys
from pathlib import Path

import pytest
from support.gstreamer_environment import install_element, user_environment

pytestmark = [
    pytest.mark.slow,
    pytest.mark.needs_programs("gst-launch-1.0"),
    pytest.mark.needs_gstreamer_python,
]


@pytest.fixture
def user(tmp_path):
    """A user's environment without the element."""
    environment, _ = user_environment(tmp_path)
    return environment


def _find(environment):
    return subprocess.run(
        ["gst-inspect-1.0", "nlens"], env=environment, capture_output=True, text=True, check=False
    )


def test_element_is_found_where_gstreamer_failed_to_load_it_before(user):
    assert _find(user).returncode != 0  # and its registry says for ever that the loader fails
    run = install_element(user)
    assert run.returncode == 0, run.stderr
    found = _find(user)
    assert found.returncode == 0 and not found.stderr


@pytest.mark.parametrize(("word", "code"), [("--help", 0), ("--uninstall", 2), ("now", 2)])
def test_words_beside_the_command_install_nothing(user, word, code):
    run = subprocess.run(
        ["python", "-m", "nlens_video.adapters.gstreamer_install", word], env=user,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == code and "usage: " in run.stdout + run.stderr
    assert not list(Path(user["HOME"]).iterdir())


def test_environment_of_another_that_hides_the_element_is_said(user, tmp_path):
    assert install_element(user).returncode == 0
    other = tmp_path / "other"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", other], check=True)
    ours = user["PATH"].partition(":")[0]
    (other / "bin" / "python").unlink()  # its python3, which the loader takes, stays
    hidden = user | {"PATH": f"{other / 'bin'}:{user['PATH']}"}
    run = install_element(hidden | {"GST_REGISTRY": str(tmp_path / "another")})
    assert run.returncode == 2 and run.stderr.endswith(f"put {ours} first on the PATH\n")
    assert "GStreamer cannot load nlens" in run.stderr


def test_element_goes_with_its_pipeline(environment, tmp_path):
    script = """
import gc, gi
gi.require_version("Gst", "1.0")
from gi.repository import Gst
Gst.init(None)
gone = []
for line in ("nlens name=lens", "nlens ! nlens name=lens"):
    pipeline = Gst.parse_launch(f"videotestsrc num-buffers=1 ! {line} ! fakesink")
    lens = pipeline.get_by_name("lens")
    lens.weak_ref(lambda: gone.append(line))
    pipeline.set_state(Gst.State.NULL)
    del lens, pipeline
    gc.collect()
bin = Gst.Bin()
lens = Gst.ElementFactory.make("nlens")
lens.weak_ref(lambda: gone.append("made in Python"))
bin.add(lens)
del bin, lens
gc.collect()
print(len(gone))
"""
    run = subprocess.run(
        ["python", "-c", script], env=environment, cwd=tmp_path, capture_output=True, text=True,
        check=False, timeout=60,
    )  # fmt: skip
    assert (run.returncode, run.stdout, run.stderr) == (0, "3\n", "")
