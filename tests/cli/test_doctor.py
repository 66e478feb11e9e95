"""What `doctor` finds on this machine."""

import json
import shutil

import pytest

from nlens_video.cli import doctor
from nlens_video.networks import model_store


def networks(capsys):
    """The exit code, and what is said of the networks."""
    code = doctor.examine(as_json=True)
    findings = {one["what"]: one for one in json.loads(capsys.readouterr().out)}
    return code, findings["networks"]


def test_every_shipped_network_is_verified(capsys):
    _, said = networks(capsys)
    assert said["works"] is True
    assert all(name in said["detail"] for name in ("coc", "lens", "sun", "camera", "reblur"))


@pytest.mark.parametrize("damage", ["missing", "altered"])
def test_network_that_is_missing_or_altered_is_a_fault(tmp_path, monkeypatch, capsys, damage):
    folder = tmp_path / "models"
    shutil.copytree(
        model_store.models_folder(), folder, ignore=lambda _, names: {
            name for name in names if name.endswith((".py", ".pt", ".npz", ".png"))
        },
    )  # fmt: skip
    (weights,) = folder.rglob("sun.onnx")
    weights.unlink() if damage == "missing" else weights.write_bytes(b"other")
    monkeypatch.setattr(model_store, "models_folder", lambda: folder)
    code, said = networks(capsys)
    assert (code, said["works"]) == (1, False)
    assert "sun.onnx" in said["detail"]
