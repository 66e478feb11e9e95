"""OpenEXR layers, plates and AOVs."""

import av
import numpy as np
import OpenEXR
import PIL.Image
import pytest
from support.clips import copy, write_clip

from nlens_video.core.errors import InputError, OutputError
from nlens_video.core.layers import Box
from nlens_video.video.exr import LINEAR, LayerReader, read_exr, read_layer, write_layers
from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink
from nlens_video.video.pixels.light_channels import picture_channels
from nlens_video.video.pixels.picture import ArrayPicture


def channels(height=6, width=8):
    rng = np.random.default_rng(0)
    made = {name: rng.random((height, width), dtype=np.float32) for name in "RGBA"}
    return {**made, "Z": rng.uniform(1, 9, (height, width)).astype(np.float32)}


@pytest.mark.parametrize("box", [None, Box(2, 1, 10, 7), Box(-3, -2, 5, 4)])
def test_exr_layer_is_placed_by_its_data_window(tmp_path, box):
    made = channels()
    write_layers(tmp_path / "a.exr", made, box, (32, 24))
    layer = read_layer(tmp_path / "a.exr", (32, 24))
    assert layer.box == (box or Box(0, 0, 8, 6))
    np.testing.assert_array_equal(layer.rgba[..., 1], made["G"])
    np.testing.assert_array_equal(layer.depth, made["Z"])


@pytest.mark.parametrize("nothing", [0.0, np.inf, np.nan, 1e10])
def test_exr_depth_of_empty_pixels_is_infinite(tmp_path, nothing):
    made = channels()
    made["Z"][2, 3] = nothing
    write_layers(tmp_path / "a.exr", made)
    depth = read_layer(tmp_path / "a.exr").depth
    assert depth[2, 3] == np.inf
    assert np.isfinite(depth).sum() == depth.size - 1


def test_alpha_of_a_sharpening_filter_hides_no_more_than_all_of_the_plate(tmp_path):
    made = channels()
    made["A"][0, :3] = (1.5, -0.1, 0.25)
    write_layers(tmp_path / "a.exr", made)
    rgba = read_layer(tmp_path / "a.exr").rgba
    assert rgba[0, :3, 3].tolist() == [1.0, 0.0, 0.25]
    np.testing.assert_array_equal(rgba[..., 0], made["R"])


def with_primaries(path, xy, made):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File({**header, "chromaticities": xy}, made) as file:
        file.write(str(path))


ACESCG = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
# of BT.709 red, green and blue in ACEScg (colour-science, Bradford)
IN_ACESCG = [[0.6131, 0.0702, 0.0206], [0.3395, 0.9164, 0.1096], [0.0474, 0.0135, 0.8698]]


def test_layers_and_plates_have_the_primaries_of_their_header(tmp_path):
    made = channels(1, 3)
    for name, values in zip("RGB", np.transpose(IN_ACESCG), strict=True):
        made[name][0] = values
    with_primaries(tmp_path / "a.exr", ACESCG, made)
    rgba = read_layer(tmp_path / "a.exr").rgba
    np.testing.assert_allclose(rgba[0, :, :3], np.eye(3), atol=2e-3)
    with open_source(str(tmp_path / "a.exr")) as source:
        assert source.info.tags.primaries == "ap1"
        (frame,) = source
        linear = frame.picture.linear(Box(0, 0, 3, 1))
        np.testing.assert_allclose(linear[0], rgba[0, :, :3], atol=2e-3)


def test_results_of_an_acescg_plate_keep_its_header_or_become_bt709(tmp_path):
    made = channels(1, 3)
    for name, values in zip("RGB", np.transpose(IN_ACESCG), strict=True):
        made[name][0] = 0.5 * values
    with_primaries(tmp_path / "a.exr", ACESCG, {name: made[name] for name in "RGB"})
    for ending in ("exr", "png"):
        with open_source(str(tmp_path / "a.exr")) as source:
            with open_sink(str(tmp_path / f"b.{ending}"), source.info) as sink:
                for frame in source:
                    sink.write(frame)
                sink.commit()
    kept = read_exr(tmp_path / "b.exr")
    assert kept.primaries == "ap1"
    np.testing.assert_array_equal(kept.channels["G"], made["G"])
    with av.open(str(tmp_path / "b.png")) as picture:
        (shown,) = picture.decode(video=0)
    np.testing.assert_allclose(shown.to_ndarray(format="rgb24")[0], 188 * np.eye(3), atol=3)


def test_oddities_of_layers_are_told_once(tmp_path):
    made = channels()
    made["A"][0, 0] = 1.005
    write_layers(tmp_path / "l_1.exr", made)
    made["A"][0, 0] = 1.5
    with_primaries(tmp_path / "l_2.exr", (0.5, 0.3, 0.2, 0.7, 0.1, 0.1, 0.3, 0.3), made)
    with_primaries(tmp_path / "l_3.exr", ACESCG, made)
    reader = LayerReader(str(tmp_path / "l_%d.exr"), (8, 6))
    reader.read(0)
    assert reader.notes == ()
    reader.read(1)
    alpha, primaries = reader.notes
    assert "to 1.5 is cut" in alpha and "primaries that are not known" in primaries
    reader.read(2)
    assert reader.notes == (alpha, primaries)


def test_missing_exr_channel_is_named(tmp_path):
    made = channels()
    del made["Z"]
    write_layers(tmp_path / "a.exr", made)
    with pytest.raises(InputError, match="channels Z are missing"):
        read_layer(tmp_path / "a.exr")


def test_exr_layer_of_another_size_is_refused(tmp_path):
    write_layers(tmp_path / "a.exr", channels())
    with pytest.raises(InputError, match="8x6 pixels, the plate has 9x6"):
        read_layer(tmp_path / "a.exr", (9, 6))


def test_exr_sequence_starts_at_its_first_number_and_reports_its_end(tmp_path):
    for number in (5, 6):
        made = channels()
        made["R"][:] = number
        write_layers(tmp_path / f"l_{number:04d}.exr", made)
    reader = LayerReader(str(tmp_path / "l_%04d.exr"), (8, 6))
    assert [reader.read(index).rgba[0, 0, 0] for index in (0, 1)] == [5.0, 6.0]
    with pytest.raises(InputError, match="the layers end before frame 2"):
        reader.read(2)


def test_single_exr_file_serves_every_frame(tmp_path):
    write_layers(tmp_path / "l.exr", channels())
    reader = LayerReader(str(tmp_path / "l.exr"), (8, 6))
    np.testing.assert_array_equal(reader.read(0).rgba, reader.read(99).rgba)


def test_exr_plate_keeps_light_far_above_white(tmp_path):
    made = {name: part * 500.0 for name, part in channels().items() if name in "RGB"}
    write_layers(tmp_path / "in.exr", made)
    with open_source(str(tmp_path / "in.exr")) as source:
        with open_sink(str(tmp_path / "out.exr"), source.info) as sink:
            for frame in source:
                frame.picture.composite_over(Box(0, 0, 2, 2), np.ones((2, 2, 4), np.float32))
                sink.write(frame)
            sink.commit()
    out = read_exr(tmp_path / "out.exr").channels
    for name, part in made.items():
        np.testing.assert_array_equal(out[name][2:], part[2:])
        np.testing.assert_allclose(out[name][:2, :2], 1.0, rtol=1e-5)


def test_aovs_into_a_missing_folder_are_refused(tmp_path):
    with pytest.raises(OutputError, match="does not exist"):
        write_layers(tmp_path / "no" / "a.exr", channels())


def composited(tmp_path, name, **options):
    """Colour .25 of alpha .5 under a layer of .2 and .5, as a sink writes it."""
    made = {name: np.full((16, 16), 0.25, np.float32) for name in "RGB"}
    write_layers(tmp_path / "in.exr", {**made, "A": np.full((16, 16), 0.5, np.float32)})
    rgba = np.full((16, 16, 4), (0.2, 0.2, 0.2, 0.5), np.float32)
    with open_source(str(tmp_path / "in.exr")) as source:
        with open_sink(str(tmp_path / name), source.info, **options) as sink:
            for frame in source:
                frame.picture.composite_over(Box(0, 0, 16, 16), rgba)
                sink.write(frame)
            sink.commit()
    return tmp_path / name


def test_openexr_colours_are_premultiplied_by_their_alpha(tmp_path):
    out = read_exr(composited(tmp_path, "out.exr")).channels
    for name, light in {"R": 0.325, "G": 0.325, "B": 0.325, "A": 0.75}.items():
        np.testing.assert_allclose(out[name], light, rtol=1e-4)


@pytest.mark.parametrize(
    ("pixel_format", "light"), [("rgba64be", 0.325 / 0.75), ("rgb48be", 0.325)]
)
def test_premultiplied_colours_become_straight_in_formats_with_straight_alpha(
    tmp_path, pixel_format, light
):
    with open_source(str(composited(tmp_path, "out.png", pix_fmt=pixel_format))) as source:
        (frame,) = source
        assert source.info.pixel_format == pixel_format
        np.testing.assert_allclose(frame.picture.linear(Box(0, 0, 16, 16)), light, rtol=2e-3)


def test_exr_output_of_straight_colours_is_premultiplied(tmp_path):
    array = np.full((4, 4, 4), (0.1, 0.2, 0.4, 0.5), np.float32)
    out = picture_channels(ArrayPicture(array, "bgr", LINEAR))
    assert [float(out[name][0, 0]) for name in "RGBA"] == pytest.approx([0.2, 0.1, 0.05, 0.5])


def store(path, made):
    """An OpenEXR file of channels in their own types."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, dict(made)) as file:  # it changes the dictionary
        file.write(str(path))


def half_channels(names="RGB"):
    return {name: part.astype(np.float16) for name, part in channels().items() if name in names}


@pytest.mark.parametrize("names", ["RGB", "RGBA"])
def test_half_float_stays_half_float_to_the_bit(tmp_path, names):
    made = [half_channels(names), half_channels(names)]
    made[1]["G"][2, 3] = np.inf
    for number, one in enumerate(made):
        store(tmp_path / f"p_{number}.exr", one)
    copy(tmp_path / "p_%d.exr", tmp_path / "out_%d.exr")
    for number, one in enumerate(made):
        found = read_exr(tmp_path / f"out_{number}.exr")
        assert found.half == set(names)
        for name in names:
            np.testing.assert_array_equal(found.channels[name], one[name].astype(np.float32))


@pytest.mark.parametrize("mixed", ["R", "RGB"])
def test_float_stays_float_where_a_channel_of_the_picture_is(tmp_path, mixed):
    wide = {name: part for name, part in channels().items() if name in mixed}
    store(tmp_path / "in.exr", {**half_channels(), **wide})
    copy(tmp_path / "in.exr", tmp_path / "out.exr")
    assert read_exr(tmp_path / "out.exr").half == set()


def test_depth_beside_half_float_does_not_count(tmp_path):
    store(tmp_path / "in.exr", {**half_channels(), "Z": channels()["Z"]})
    copy(tmp_path / "in.exr", tmp_path / "out.exr")
    assert read_exr(tmp_path / "out.exr").half == set("RGB")


def test_light_beyond_half_float_becomes_its_largest(tmp_path):
    bright = np.array([[70000.0, -70000.0, np.inf, 1.5]], np.float32)
    write_layers(tmp_path / "a.exr", {"R": bright}, half=True)
    found = read_exr(tmp_path / "a.exr").channels["R"]
    np.testing.assert_array_equal(found, [[65504.0, -65504.0, np.inf, 1.5]])


SHOT = {
    "owner": "show_x", "reelName": "A001C003", "expTime": 0.0208, "camera:iso": "800",
    "pixelAspectRatio": 2.0, "cryptomatte/ab": "uint32", "views": ["left", "right"],
}  # fmt: skip


def store_shot(path, made, *, box=None, size=None, second=0, **more):
    """A file of a shot: attributes, a timecode, DWAA; the display window begins at 100, 50."""
    x0, y0, x1, y1 = box or (100, 50, 108, 56)
    width, height = size or (8, 6)
    header = {
        "compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage,
        "dataWindow": (np.array([x0, y0], "i4"), np.array([x1 - 1, y1 - 1], "i4")),
        "displayWindow": (
            np.array([100, 50], "i4"), np.array([99 + width, 49 + height], "i4"),
        ),
        "timeCode": OpenEXR.TimeCode(1, 2, second, 4, *[0] * 14), **SHOT, **more,
    }  # fmt: skip
    with OpenEXR.File(header, dict(made)) as file:  # it changes the dictionary
        file.write(str(path))


def stored(path):
    """Header and samples of a file, in their own types."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        samples = {name: channel.pixels for name, channel in file.channels().items()}
        return dict(file.header()), samples


def test_attributes_and_compression_of_each_file_of_a_sequence_stay(tmp_path):
    for number in (7, 8):
        store_shot(tmp_path / f"p_{number}.exr", half_channels(), second=number)
    assert copy(tmp_path / "p_%d.exr", tmp_path / "out_%d.exr") == ()
    for number in (7, 8):
        was, has = (stored(tmp_path / f"{name}_{number}.exr")[0] for name in ("p", "out"))
        assert has["timeCode"].seconds == number
        for name in ("compression", *SHOT):
            assert has[name] == was[name], name
        np.testing.assert_array_equal(has["displayWindow"], was["displayWindow"])


def further_channels(height, width):
    """Channels beside the picture, in each of OpenEXR's types."""
    rng = np.random.default_rng(1)
    return {
        "Z": rng.random((height, width), np.float32),
        "matte.hero": rng.random((height, width)).astype(np.float16),
        "id": rng.integers(1 << 31, 1 << 32, (height, width), np.uint32),
    }


@pytest.mark.parametrize(
    "box", [(100, 50, 108, 56), (96, 47, 112, 58), (102, 51, 106, 54), (98, 52, 106, 60)]
)
def test_further_channels_and_overscan_stay_to_the_bit(tmp_path, box):
    height, width = box[3] - box[1], box[2] - box[0]
    picture = {name: part[:1, :1] for name, part in half_channels().items()}
    picture = {name: np.tile(part, (height, width)) for name, part in picture.items()}
    made = {**picture, **further_channels(height, width)}
    store_shot(tmp_path / "in.exr", made, box=box)
    copy(tmp_path / "in.exr", tmp_path / "out.exr", box=Box(0, 0, 8, 6))
    header, found = stored(tmp_path / "out.exr")
    (x0, y0), (x1, y1) = header["dataWindow"]
    assert (x0, y0) == (min(box[0], 100), min(box[1], 50))
    assert (x1, y1) == (max(box[2], 108) - 1, max(box[3], 56) - 1)
    own = np.s_[box[1] - y0 : box[3] - y0, box[0] - x0 : box[2] - x0]
    shown = np.s_[50 - y0 : 56 - y0, 100 - x0 : 108 - x0]
    for name, part in made.items():
        assert found[name].dtype == part.dtype
        if name in picture:
            outside = np.ones(found[name].shape, bool)
            outside[shown] = False
            np.testing.assert_array_equal(found[name][own][outside[own]], part[outside[own]])
            assert (found[name][shown] > 0.4).all()  # the layer of 0.5 lies over it
        else:
            np.testing.assert_array_equal(found[name][own], part)


def test_grey_plate_with_further_channels_becomes_a_coloured_picture_beside_them(tmp_path):
    made = {"Y": half_channels()["R"], **further_channels(6, 8)}
    store_shot(tmp_path / "in.exr", made)
    copy(tmp_path / "in.exr", tmp_path / "out.exr")
    _, found = stored(tmp_path / "out.exr")
    assert set(found) == {"R", "G", "B", "Z", "matte.hero", "id"}
    np.testing.assert_array_equal(found["G"], made["Y"])


def test_picture_of_a_range_gets_the_attributes_of_its_own_file(tmp_path):
    for number in (3, 4):
        store_shot(tmp_path / f"p_{number}.exr", half_channels(), second=number)
    spec = str(tmp_path / "p_%d.exr")
    with open_source(spec) as source:
        with open_sink(str(tmp_path / "one.exr"), source.info, one_frame=True) as sink:
            sink.write(list(source)[1])
            sink.commit()
    assert stored(tmp_path / "one.exr")[0]["timeCode"].seconds == 4


def test_unknown_primaries_stay_in_the_header(tmp_path):
    odd = (0.5, 0.3, 0.2, 0.7, 0.1, 0.1, 0.3, 0.3)
    store_shot(tmp_path / "in.exr", half_channels(), chromaticities=odd)
    copy(tmp_path / "in.exr", tmp_path / "out.exr")
    assert stored(tmp_path / "out.exr")[0]["chromaticities"] == pytest.approx(odd)


def test_further_parts_are_left_out_with_a_note(tmp_path):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    parts = [
        OpenEXR.Part(dict(header), half_channels(), "beauty"),
        OpenEXR.Part(dict(header), {"Z": channels()["Z"]}, "depth"),
    ]
    with OpenEXR.File(parts) as file:
        file.write(str(tmp_path / "in.exr"))
    (note,) = copy(tmp_path / "in.exr", tmp_path / "out.exr")
    assert note == "the first of 2 parts is kept: the picture is taken from it"
    assert set(stored(tmp_path / "out.exr")[1]) == set("RGB")


def test_rate_that_is_a_fraction_and_attributes_of_unknown_types_stay(tmp_path):
    picture = av.VideoFrame.from_ndarray(np.zeros((6, 8, 3), np.float32), "gbrpf32le")
    with av.open(str(tmp_path / "in.exr"), "w", format="image2") as out:
        stream = out.add_stream("exr", 24)  # FFmpeg writes the rate as a fraction
        stream.width, stream.height, stream.pix_fmt = 8, 6, "gbrpf32le"
        out.mux([*stream.encode(picture), *stream.encode(None)])
    data = (tmp_path / "in.exr").read_bytes()
    odd = data.replace(b"writer\0string\0", b"writer\0strinx\0")
    (tmp_path / "in.exr").write_bytes(odd)
    assert len(odd) == len(data) and odd != data
    copy(tmp_path / "in.exr", tmp_path / "out.exr")
    assert stored(tmp_path / "out.exr")[0]["framesPerSecond"] == 24
    assert b"writer\0strinx\0\x04\0\0\0lavc" in (tmp_path / "out.exr").read_bytes()


@pytest.mark.parametrize("name", ["in.png", "in.mov", "in.mkv"])
def test_straight_alpha_of_other_plates_becomes_that_of_openexr(tmp_path, name):
    """White of alpha .25 on the left and 1 on the right."""
    rgba = np.full((48, 64, 4), 65535, np.uint16)
    rgba[:, :32, 3] = 16384
    frame = av.VideoFrame.from_ndarray(rgba, "rgba64le")
    if name == "in.png":
        PIL.Image.fromarray((rgba >> 8).astype(np.uint8)).save(tmp_path / name)
    elif name == "in.mov":
        held = frame.reformat(format="yuva444p10le")
        write_clip(tmp_path / name, [held], codec="prores_ks", options={"profile": "4444"})
    else:
        write_clip(tmp_path / name, [frame.reformat(format="gbrap16le")])
    copy(tmp_path / name, tmp_path / "out.exr", one_frame=True)
    made = read_exr(tmp_path / "out.exr").channels
    assert sorted(made) == ["A", "B", "G", "R"]
    for channel in "ARGB":
        left, right = made[channel][24, 8], made[channel][24, 56]
        assert (left, right) == pytest.approx((0.25, 1.0), abs=0.01)


def test_plate_of_primaries_that_are_not_known_is_noted(tmp_path):
    light = {name: np.full((8, 8), 0.5, np.float32) for name in "RGB"}
    for name, green in (("adobe", (0.21, 0.71)), ("bt709", (0.3, 0.6))):
        told = (0.64, 0.33, *green, 0.15, 0.06, 0.3127, 0.329)
        header = {"type": OpenEXR.scanlineimage, "chromaticities": told}
        with OpenEXR.File(header, light) as file:
            file.write(str(tmp_path / f"{name}.exr"))
        with open_source(str(tmp_path / f"{name}.exr")) as source:
            notes = [note for note in source.info.notes if "primaries that are not known" in note]
        assert len(notes) == (name == "adobe")
