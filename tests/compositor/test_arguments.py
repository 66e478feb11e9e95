"""The options of a `Compositor`: the command line's, under the same names."""

import inspect
import re
import subprocess
import sys
from fractions import Fraction
from pydoc import locate

import numpy as np
import pytest
from support import shots

import nlens_video
from nlens_video import Compositor
from nlens_video.compositor.arguments import PARAMETERS, in_python
from nlens_video.core.errors import UsageError
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.objects import FurtherObject, PlaceKey, PlaceKeys
from nlens_video.core.placement import GroundPlacing, Placement
from nlens_video.core.settings import ObjectSettings
from nlens_video.options.parser import parser_of

FIT = LensFit(slope=shots.SLOPE, intercept=shots.INTERCEPT, width=shots.WIDTH, height=shots.HEIGHT)
FILES_AND_STREAMS = {
    "input", "output", "glb", "layers", "input_format", "input_size", "input_rate",
    "input_transfer", "range", "report", "save_fit", "save_shot", "aov", "timings", "codec",
    "crf", "pix_fmt",
    "keep_partial", "as_chunk", "resume", "reconnect", "late", "hold_budget", "overwrite", "frame",
    "marker", "person_height", "person", "ignore_lines",
}  # fmt: skip
DEFAULTS = set(PARAMETERS) - {"at", "fit"} | {"optics"}
OF_SEVERAL_OBJECTS = {"others", "keys", "interpolation"}  # in `ObjectSettings`
TALK = {
    "help", "version", "verbose", "quiet", "json", "no_progress", "progress_lines", "plan",
}  # fmt: skip


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """A cube without a camera and without lights."""
    path = tmp_path_factory.mktemp("glb") / "bare.glb"
    return shots.cube_glb(path, camera=False, sun=False)


def bgr():
    return np.ascontiguousarray(shots.plate()[..., ::-1])


def test_every_command_line_option_about_frames_is_a_parameter_of_its_name():
    signature = inspect.signature(Compositor)
    elsewhere = FILES_AND_STREAMS | TALK | OF_SEVERAL_OBJECTS
    names = {
        action.option_strings[0].lstrip("-").replace("-", "_")
        for action in parser_of("render")._actions
        if action.option_strings and action.dest not in elsewhere
    }
    assert names == set(signature.parameters) - {"glb", "fps", "pixel_aspect", "optics"}
    assert names >= set(PARAMETERS)
    assert all(
        one.annotation is not inspect.Parameter.empty for one in signature.parameters.values()
    )


def test_classes_that_a_description_names_lie_where_it_says():
    named = re.findall(r"`([a-z_]+(?:\.[a-z_]+)*\.[A-Z]\w+)`", inspect.getdoc(Compositor))
    assert len(named) == 2 and all(inspect.isclass(locate(name)) for name in named)


def test_dir_of_the_package_lists_its_public_names():
    code = "import nlens_video, sys; print(*dir(nlens_video)); assert 'numpy' not in sys.modules"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"Compositor", "LensFit", "__version__"} <= set(out.stdout.split())
    assert set(nlens_video.__all__) <= set(dir(nlens_video))


@pytest.mark.needs_gl
def test_object_without_a_camera_is_placed_by_keywords(bare):
    frame = bgr()
    with Compositor(bare, preset="draft", fit=FIT, at=(0.5, 0.8), size=0.3, horizon=0.3) as lens:
        right = np.abs(lens.process(frame).astype(int) - frame).max(axis=2) > 8
        assert any(
            "placed by at=(0.5, 0.8) size=0.3 yaw=0 horizon=0.3" in line for line in lens.plan
        )
    rows, columns = np.nonzero(right)
    assert abs(columns.mean() / frame.shape[1] - 0.5) < 0.05
    assert 0.45 < rows.mean() / frame.shape[0] < 0.8


@pytest.mark.needs_gl
def test_object_that_is_placed_without_a_size_gets_a_usual_one(bare):
    with Compositor(bare, preset="draft", fit=FIT, at=(0.5, 0.8)) as lens:
        lens.process(bgr())
        assert any(
            "placed by at=(0.5, 0.8) size=0.35 yaw=0 horizon=0.5" in line for line in lens.plan
        )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"at": (0.5, 0.2), "size": 0.3}, "at=(0.5, 0.2)"),
        ({"at": (0.5, 0.8), "size": -1}, "size=-1"),
        ({"at": "left", "size": 0.3}, "at='left': 'left' is not X,Y"),
        ({"at": (0.5, 0.8), "size": "big"}, "size='big': 'big' is not a number"),
        ({"at": (0.5, 0.8), "size": 0.3, "fov": 190}, "fov=190: '190' is not an angle from 1 to"),
        ({"at": (0.5, 0.8), "size": 0.3, "yaw": float("nan")}, "yaw=nan: 'nan' is not a number"),
        ({"at": (0.5, 0.8), "height": 0.4}, "height needs a camera in metres (camera_from)"),
        ({"fov": 40}, "fov is of a placed object; give at too"),
        ({"size": 0.3}, "to place the object give at, fractions of the frame, or camera_from"),
        ({"yaw": 10}, "to place the object give at, fractions"),
        ({"horizon": 0.3}, "to place the object under horizon give at, fractions"),
        ({"env_rotation": 20}, "env_rotation needs a map; give env_map too"),
        ({"shadow_strength": 3}, "shadow_strength=3: '3' is not a number from 0 to 2"),
        ({"effects": "glitter"}, "effects: 'glitter' is not an effect"),
        ({"effects": "auto,-shadow,+shadow"}, "shadow is both added"),
        ({"preset": "fast"}, "fast"),
        ({"device": "gpu"}, "device='gpu': expected one of auto, cpu, cuda"),
        ({"fallback": "zero"}, "fallback='zero': expected one of none, constant"),
        ({"cat_eye": 2.0}, "cat-eye 2.0"),
        ({"shutter_angle": 400}, "shutter_angle=400"),
        ({"ground_reflectance": 2}, "ground_reflectance=2"),
        ({"vignetting": -1}, "vignetting=-1"),
        ({"distortion": (0.1, 0.2, 0.3)}, "distortion=(0.1, 0.2, 0.3)"),
        ({"track_focus": "on"}, "track_focus='on': expected one of auto, off"),
        ({"pixel_aspect": 0}, "pixel_aspect=0: expected a finite number above 0"),
        ({"fps": "30"}, "fps='30': expected a finite number above 0"),
        ({"holdout": "m.png", "occlusion": "auto"}, "leave occlusion"),
        ({"camera": ""}, "camera='': is empty"),
        ({"loop": "no"}, "loop='no': expected True or False"),
    ],
)  # fmt: skip
def test_errors_name_parameters_instead_of_command_line_flags(bare, options, words):
    with pytest.raises(UsageError) as failed:
        Compositor(bare, **options)
    assert words in str(failed.value) and "--" not in str(failed.value)


def test_pipeline_that_would_not_composite_the_object_is_refused(bare, tmp_path):
    path = tmp_path / "part.toml"
    path.write_text('nodes = ["object-bounds", "render", "crop-sharp"]')
    with pytest.raises(UsageError, match="part.toml: has no node 'composite'"):
        Compositor(bare, preset=str(path))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("aperture", 3), ("aperture", b"7"), ("optics", 3), ("optics", {"distortion": (0.1, 0.0)}),
        ("fit", 3), ("glb", None), ("glb", b"x.glb"), ("glb", 3), ("preset", b"draft"),
        ("vignetting", b"1"), ("env_map", b"sky.hdr"),
    ],
)  # fmt: skip
def test_argument_of_another_type_is_named(bare, name, value):
    with pytest.raises(UsageError, match=f"^{name} takes .*, not {type(value).__name__}$"):
        Compositor(**{"glb": bare, name: value})


@pytest.mark.needs_gl
@pytest.mark.parametrize("one", [Fraction, np.float32, np.int64])
def test_numbers_of_pyav_and_numpy_are_numbers(bare, one):
    """A stream's rate is a `Fraction`; a place that was found in a picture is an array."""
    own = {"fps": one(25), "pixel_aspect": one(1), "at": np.array([0.5, 0.75]), "size": one(1)}
    plain = {"fps": 25, "at": (0.5, 0.75), "size": 1}
    pictures = []
    for given in (own, plain):
        with Compositor(bare, preset="draft", fit=FIT, **given) as lens:
            pictures.append(lens.process(bgr(), time=0.1))
    assert np.array_equal(*pictures)


def test_another_object_of_no_path_is_refused_when_it_is_given(bare):
    with Compositor(bare, preset="draft") as lens:
        for glb in (None, b"x.glb"):
            with pytest.raises(UsageError, match="glb takes the path of a file, or ObjectSettings"):
                lens.swap(glb)


def test_none_takes_the_default(bare):
    with (
        Compositor(bare, at=(0.5, 0.8), fit=FIT, **dict.fromkeys(DEFAULTS)) as lens,
        Compositor(bare, at=(0.5, 0.8), fit=FIT) as plain,
    ):
        assert (lens._loop.lens, lens._loop.objects) == (plain._loop.lens, plain._loop.objects)
        assert lens.timings == plain.timings


def test_object_keywords_and_object_settings_exclude_each_other(bare):
    with pytest.raises(UsageError, match="ground_y, size: stand in the ObjectSettings"):
        Compositor(ObjectSettings(glb=bare), size=0.3, ground_y=0.0)
    Compositor(ObjectSettings(glb=bare), preset="draft", shutter_angle=90.0).close()


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ("--at 400,300: fractions of the frame", "at=(400, 300): fractions of the frame"),
        ("use --preset standard", 'use preset="standard"'),
        ("give --env MAP.hdr too", "give env_map too"),
        ("--effects auto,+shadow asks", 'effects="auto,+shadow" asks'),
        ("--holdout tells what is in front", "holdout tells what is in front"),
        ("see --plan or --range 0:4", "see --plan or --range 0:4"),
    ],
)
def test_command_line_flags_in_messages_become_keyword_names(message, expected):
    assert in_python(message) == expected


def test_compositor_draws_several_objects_that_move_by_keys(bare):
    keys = PlaceKeys(
        keys=(PlaceKey(time_s=0.0, at=(0.2, 0.8)), PlaceKey(time_s=1.0, at=(0.8, 0.8)))
    )
    objects = ObjectSettings(
        glb=bare,
        placing=Placement(at=(0.5, 0.95), size=0.1, horizon=0.2),
        others=(FurtherObject(glb=bare, placing=GroundPlacing(size=0.3), keys=keys),),
    )
    grey = np.full((shots.HEIGHT, shots.WIDTH, 3), 119, np.uint8)
    with Compositor(objects, preset="draft", effects="none") as lens:
        for time_s, x in ((0.0, 0.2), (0.5, 0.5), (1.0, 0.8)):
            changed = (lens.process(grey, time=time_s) != 119).any(axis=2)
            band = changed[int(0.6 * shots.HEIGHT) : int(0.7 * shots.HEIGHT)]
            columns = np.flatnonzero(band.any(axis=0))
            assert columns.mean() / shots.WIDTH == pytest.approx(x, abs=0.03)


def test_region_of_the_fit_is_given_by_numbers(bare):
    from nlens_video.compositor.arguments import as_args

    args = as_args({"fit_region": (0.1, 0.5, 0.9, 1.0)})
    assert set(args.fit_region.corners) == {(0.1, 0.5), (0.9, 0.5), (0.9, 1.0), (0.1, 1.0)}
    with pytest.raises(UsageError, match="fit_region"):
        Compositor(bare, fit_region=(0.1, 0.5, 0.9))
