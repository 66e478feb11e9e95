import hashlib

import pytest

from nlens_video.core.errors import NlensError
from nlens_video.networks.model_store import find_model, models_folder

ENTRY = """
[model.coc]
file = "coc.onnx"
sha256 = "{digest}"
licence = "Apache-2.0"
[model.coc.inputs]
rgb = "(1, H, W, 3)"
[model.coc.outputs]
coc_px = "(1, H / 4, W / 4)"
"""


def folder_with(tmp_path, content=b"weights", digest=None):
    (tmp_path / "coc.onnx").write_bytes(content)
    digest = digest or hashlib.sha256(content).hexdigest()
    (tmp_path / "manifest.toml").write_text(ENTRY.format(digest=digest))
    return tmp_path


def test_shipped_network_matches_the_hash_in_the_manifest():
    model = find_model("coc")
    assert model.path.parent.parent == models_folder()
    assert model.path.stat().st_size < 6_000_000


def test_network_with_the_stated_hash_is_found(tmp_path):
    model = find_model("coc", folder_with(tmp_path))
    assert model.path.read_bytes() == b"weights"


def test_altered_network_is_refused_with_its_path(tmp_path):
    folder = folder_with(tmp_path)
    (folder / "coc.onnx").write_bytes(b"weightz")
    with pytest.raises(NlensError, match=r"coc\.onnx: sha256 .* not the shipped .*install"):
        find_model("coc", folder)


def test_missing_network_error_states_what_to_do(tmp_path):
    folder = folder_with(tmp_path)
    (folder / "coc.onnx").unlink()
    with pytest.raises(NlensError, match=r"coc\.onnx: .*No such file.*install the package anew"):
        find_model("coc", folder)


def test_unknown_network_error_lists_the_known_ones(tmp_path):
    with pytest.raises(NlensError, match="no network named 'depth', only: coc"):
        find_model("depth", folder_with(tmp_path))


def test_folder_without_a_manifest_is_refused(tmp_path):
    with pytest.raises(NlensError, match=r"manifest\.toml: cannot be read"):
        find_model("coc", tmp_path)


@pytest.mark.parametrize("text", ["model = 3", "nothing = 1", "[model", "\xff"])
def test_manifest_in_another_format_is_refused(tmp_path, text):
    (tmp_path / "manifest.toml").write_bytes(text.encode("latin-1"))
    with pytest.raises(NlensError, match=r"manifest\.toml: cannot be read"):
        find_model("coc", tmp_path)


def test_manifest_entry_without_a_hash_is_refused(tmp_path):
    folder = folder_with(tmp_path)
    text = (folder / "manifest.toml").read_text()
    kept = [line for line in text.splitlines() if not line.startswith("sha256")]
    (folder / "manifest.toml").write_text("\n".join(kept))
    with pytest.raises(NlensError, match="lacks 'sha256'"):
        find_model("coc", folder)
