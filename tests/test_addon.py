"""The zip of the add-on for Blender, as `make addon` makes it."""

import ast
import subprocess
import zipfile

from support.folders import ROOT

from nlens_video.core.version import VERSION

PLACE = "nlens_video_blender"


def test_zip_holds_the_add_on_of_this_version_with_its_licence(tmp_path):
    words = ["make", "-s", "-C", ROOT, "addon", f"DIST={tmp_path}"]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    with zipfile.ZipFile(tmp_path / f"{PLACE}.zip") as content:
        names = set(content.namelist()) - {f"{PLACE}/"}
        source = content.read(f"{PLACE}/__init__.py").decode()
        assert content.read(f"{PLACE}/LICENSE") == (ROOT / "LICENSE").read_bytes()
    own = {one.name for one in (ROOT / "addons" / "blender" / PLACE).glob("*.py")}
    assert names == {f"{PLACE}/{name}" for name in (*own, "LICENSE")}
    tree = ast.parse(source)
    (info,) = (
        ast.literal_eval(one.value) for one in tree.body
        if isinstance(one, ast.Assign) and ast.unparse(one.targets[0]) == "bl_info"
    )  # fmt: skip
    assert ".".join(map(str, info["version"])) == VERSION.partition("+")[0]
