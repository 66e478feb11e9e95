"""Write one animated object: python samples/make_object.py terrace --plate samples/in.json OUT.glb.

Needs no Blender: the meshes, textures, skins and keys are computed with numpy. The plate's JSON
gives the lights that fit its own.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import object_caterpillar
import object_chick

BUILDERS = {"terrace": object_caterpillar.build, "park": object_chick.build}


def write(scene: str, lights: list[dict[str, Any]], path: Path) -> None:
    """Build a scene's object under its lights and write it."""
    BUILDERS[scene](lights).save(path)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", choices=sorted(BUILDERS))
    parser.add_argument("out", type=Path)
    parser.add_argument(
        "--plate", type=Path, required=True, help="the plate's JSON, for the lights"
    )
    given = parser.parse_args()
    write(given.scene, json.loads(given.plate.read_text())["lights"], given.out)


if __name__ == "__main__":
    main()
