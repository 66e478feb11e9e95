"""What lights a plate's object: nothing but the plate, the GLB's lights, or a map."""

from __future__ import annotations

from functools import cache

import numpy as np

from nlens_video.evaluate.plates import Plate
from nlens_video.networks.lazy import lazy_sun_reader
from nlens_video.scene.environment import load_environment
from nlens_video.scene.illumination import Illumination
from nlens_video.scene.plate_environment import PLATE_COLUMNS, Seat
from nlens_video.scene.scene_light import SceneLight
from nlens_video.video.pixels.picture import ArrayPicture

MAP = "env.hdr"
GUESSED, LIGHTS, AROUND = "GLB without lights", "with its lights", "with its map"

_sun_reader = cache(lazy_sun_reader)  # one network for all plates


def light_cases(plate: Plate) -> dict[str, tuple[Illumination, Illumination]]:
    """The light on the object and on the ground, by what is known of it.

    It is found as in a run: a sun that the plate tells for sure is used where no file has one.

    Args:
        plate: a plate, whose folder may hold a map of the surroundings.
    """
    lights = plate.scene.pose(0.0).lights
    path = plate.folder / MAP
    cases = {GUESSED: SceneLight(0)}
    if lights:
        cases[LIGHTS] = SceneLight(len(lights))
    if path.is_file():
        cases[AROUND] = SceneLight(0, load_environment(path, 0.0, 0.0), exposure_given=True)
    picture = ArrayPicture(np.asarray(np.round(255.0 * plate.rgb), np.uint8), "rgb")
    rows = max(1, round(PLATE_COLUMNS * picture.height / picture.width))
    small = picture.downsample(PLATE_COLUMNS, rows)
    seat = Seat.of(plate.scene.pose(0.0).bounds(), plate.ground_y)
    seen = _sun_reader()(picture, plate.camera, plate.ground_y)
    lit = {}
    for row, light in cases.items():
        where = plate.camera, seat, lights if light.count else ()
        around = light.around_without_sun(small, *where)
        around = light.with_sun(around, picture, *where, seen)
        lit[row] = light.on_object(lights, around), light.on_ground(lights, around)
    return lit
