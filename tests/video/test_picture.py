"""Compositing on real samples: what is touched, what is not; the fast kernel by its reference."""

import copy

import av
import numpy as np
import pytest
from msgspec.structs import replace
from support.clips import noise_frame, planes, write_clip

from nlens_video.core.color import ColorTags
from nlens_video.core.errors import InputError
from nlens_video.core.layers import Box
from nlens_video.native import kernels
from nlens_video.video.exr import LINEAR
from nlens_video.video.input.source import open_source
from nlens_video.video.pixels import blend, blend_ref
from nlens_video.video.pixels.orientation import Orientation
from nlens_video.video.pixels.picture import SRGB, ArrayPicture, AvPicture
from nlens_video.video.pixels.pixel_formats import working_format
from nlens_video.video.pixels.samples import (
    FIRST_OCTAVE,
    STEPS_BITS,
    array_samples,
    frame_samples,
    frame_tags,
)

FORMATS = (
    "yuv420p", "yuvj420p", "yuv422p", "yuv444p", "yuv411p", "yuv440p", "yuv410p", "yuv420p10le",
    "yuv422p10le", "yuv444p12le", "yuva420p", "gray", "gray10le", "ya8", "gbrp", "gbrap16le",
    "rgb24", "bgr24", "rgba", "argb", "bgr0", "rgb48le", "rgba64le",
)  # fmt: skip


RED_CR = 255
"""Cr of pure red in full range."""


def layer(height, width, seed=1):
    """Premultiplied colour and alpha with holes, opaque parts and light brighter than white."""
    rng = np.random.default_rng(seed)
    rgba = rng.random((height, width, 4), dtype=np.float32)
    rgba[rng.random((height, width)) < 0.3, 3] = 1.0
    rgba[..., :3] *= rgba[..., 3:] * 1.5
    rgba[rng.random((height, width)) < 0.4] = 0.0
    return rgba


@pytest.mark.parametrize(
    ("pixel_format", "turns"),
    [(name, 0) for name in FORMATS]
    + [(name, turns) for name in ("yuv420p", "yuv422p10le", "yuv411p") for turns in (1, 2, 3)],
)
def test_fast_blend_is_within_a_code_value_of_the_reference(pixel_format, turns):
    frame = noise_frame(37, 27, pixel_format)
    samples = frame_samples(frame, frame_tags(frame), Orientation(90 * turns))
    slow = copy.deepcopy(samples)
    box = Box(3, 2, 24, 21)
    np.testing.assert_allclose(
        blend.linear(samples, box), blend_ref.linear(slow, box), rtol=2e-4, atol=2e-5
    )
    frame.make_writable()
    samples = frame_samples(frame, frame_tags(frame), Orientation(90 * turns))
    blend.composite_over(samples, box, layer(19, 21))
    blend_ref.composite_over(slow, box, layer(19, 21))
    for fast, reference in zip(samples.planes, slow.planes, strict=True):
        error = np.abs(fast.astype(np.int64) - reference.astype(np.int64))
        limit = 4 if samples.coding.bits == 16 else 1  # 16-bit codes are finer than the tables
        assert error.max() <= limit
        assert error.mean() < 0.01 * limit**2


@pytest.mark.parametrize(("width", "height"), [(37, 27), (160, 90), (9, 5)])
@pytest.mark.parametrize(
    ("pixel_format", "turns"), [("yuv420p", 0), ("yuv411p", 1), ("yuv422p10le", 2), ("gray", 0)]
)
def test_fast_downsampling_agrees_with_the_reference(width, height, pixel_format, turns):
    frame = noise_frame(width, height, pixel_format)
    samples = frame_samples(frame, frame_tags(frame), Orientation(90 * turns))
    found, expected = (way.downsample(samples, 16, 10) for way in (blend, blend_ref))
    assert found.shape == (10, 16, 3)
    np.testing.assert_allclose(found, expected, rtol=2e-4, atol=2e-5)


@pytest.mark.parametrize("rotation", [0, 90, 180, -90])
def test_picture_has_its_display_width(rotation):
    picture = AvPicture(noise_frame(36, 20, "yuv420p"), orientation=Orientation(rotation))
    assert picture.srgb().shape == (picture.height, picture.width, 3)
    assert (picture.width > picture.height) == (rotation in {0, 180})


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p10le", "rgb24", "rgba"])
def test_layer_colours_relative_to_the_plate_agree_with_the_reference(pixel_format):
    frame = noise_frame(32, 24, pixel_format)
    frame.color_primaries = 9  # its own primaries are not those of the layer
    frame.make_writable()
    samples = frame_samples(frame, frame_tags(frame))
    slow, box = copy.deepcopy(samples), Box(0, 0, 32, 24)
    loss = layer(24, 32)
    loss[..., :3] = 0.3 * (loss[..., :3] - 0.2) * (loss[..., 3:] > 0)  # both signs
    blend.composite_over(samples, box, loss, of_plate=True)
    blend_ref.composite_over(slow, box, loss, of_plate=True)
    for fast, reference in zip(samples.planes, slow.planes, strict=True):
        assert np.abs(fast.astype(int) - reference.astype(int)).max() <= 1


def test_layer_colours_relative_to_the_plate_agree_with_a_hand_calculation():
    plate = np.full((2, 2, 3), 0.4, np.float32)
    picture = ArrayPicture(plate, "rgb", LINEAR)
    layer_ = np.zeros((2, 2, 4), np.float32)
    layer_[0, 0] = (0.25, -0.125, 0.0, 0.5)  # a half is gone, of red a quarter comes back
    picture.composite_over(Box(0, 0, 2, 2), layer_, of_plate=True)
    assert plate[0, 0] == pytest.approx([0.3, 0.15, 0.2], abs=1e-6)
    assert (plate[1] == np.float32(0.4)).all()


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p10le", "rgb24"])
def test_loss_of_light_below_half_a_code_leaves_integer_samples_alone(pixel_format):
    frame = noise_frame(32, 24, pixel_format)
    samples = frame_samples(frame, frame_tags(frame))
    slow, before = copy.deepcopy(samples), copy.deepcopy(samples)
    loss = np.zeros((24, 32, 4), np.float32)
    loss[:12, :, 3], loss[12:, :, 3] = 0.4 / samples.coding.peak, 0.3
    blend.composite_over(samples, Box(0, 0, 32, 24), loss, of_plate=True)
    blend_ref.composite_over(slow, Box(0, 0, 32, 24), loss, of_plate=True)
    for fast, reference, old in zip(samples.planes, slow.planes, before.planes, strict=True):
        half = len(old) // 2
        assert (fast[:half] == old[:half]).all()
        assert (fast[half:] != old[half:]).any()
        assert np.abs(fast.astype(int) - reference.astype(int)).max() <= 1


def test_the_least_loss_of_light_changes_float_samples():
    plate = np.full((2, 2, 3), 0.4, np.float32)
    loss = np.full((2, 2, 4), (0.0, 0.0, 0.0, 1e-4), np.float32)
    ArrayPicture(plate, "rgb", LINEAR).composite_over(Box(0, 0, 2, 2), loss, of_plate=True)
    assert plate == pytest.approx(np.full((2, 2, 3), 0.4 * (1.0 - 1e-4)), abs=1e-7)


@pytest.mark.parametrize("curve", [16, 18, 8, 13])
def test_fast_blend_supports_every_transfer_function(curve):
    frame = noise_frame(32, 24, "yuv420p10le")
    frame.color_trc, frame.colorspace, frame.color_primaries = curve, 9, 9
    samples = frame_samples(frame, frame_tags(frame))
    slow = copy.deepcopy(samples)
    box = Box(0, 0, 32, 24)
    blend.composite_over(samples, box, layer(24, 32))
    blend_ref.composite_over(slow, box, layer(24, 32))
    for fast, reference in zip(samples.planes, slow.planes, strict=True):
        assert np.abs(fast.astype(int) - reference.astype(int)).max() <= 1


@pytest.mark.parametrize("rotation", [0, 90, 180, 270])
@pytest.mark.parametrize("pixel_format", FORMATS)
def test_samples_under_an_empty_layer_keep_their_bits(pixel_format, rotation):
    frame = noise_frame(37, 27, pixel_format)
    before = planes(frame)
    picture = AvPicture(frame, orientation=Orientation(rotation))
    whole = Box(0, 0, picture.width, picture.height)
    picture.composite_over(whole, np.zeros((whole.height, whole.width, 4), np.float32))
    for old, new in zip(before, planes(picture.frame), strict=True):
        np.testing.assert_array_equal(old, new)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("rotation", [0, 90, 180, 270])
@pytest.mark.parametrize("pixel_format", FORMATS)
def test_odd_picture_that_is_turned_or_mirrored_shows_the_same_light(
    pixel_format, rotation, mirrored
):
    frame = noise_frame(37, 27, pixel_format)
    stored, shown = AvPicture(frame), AvPicture(frame, orientation=Orientation(rotation, mirrored))
    expected = np.rot90(stored.linear(Box(0, 0, 37, 27)), rotation // 90)
    expected = expected[:, ::-1] if mirrored else expected
    np.testing.assert_array_equal(shown.linear(Box(0, 0, shown.width, shown.height)), expected)


def test_only_chroma_samples_touched_by_the_layer_change():
    frame = noise_frame(32, 24, "yuv420p")
    before = planes(frame)
    AvPicture(frame).composite_over(Box(8, 6, 12, 10), np.full((4, 4, 4), 0.5, np.float32))
    for (old, new), step in zip(zip(before, planes(frame), strict=True), (1, 2, 2), strict=True):
        changed = np.argwhere(old != new)
        assert changed.size
        assert changed.min(axis=0).tolist() >= [6 // step, 8 // step]
        assert changed.max(axis=0).tolist() <= [9 // step, 11 // step]


@pytest.mark.parametrize(
    ("name", "codec", "centred"),
    [
        ("in.mp4", "libx264", False),
        ("in.mov", "mjpeg", True),
        ("in.jpg", "mjpeg", True),
    ],
)
def test_full_range_chroma_is_sited_left_in_video_and_centred_in_jpeg(
    tmp_path, name, codec, centred
):
    frame = noise_frame(32, 24, "yuvj420p")
    frame.color_range = 2
    clip = tmp_path / name
    if name.endswith("jpg"):
        frame.save(str(clip))
    else:
        write_clip(clip, [frame], codec=codec)
    with open_source(str(clip)) as source:
        assert source.info.tags.full_range
        (got,) = source
    before = planes(got.picture.frame)
    rgba = np.zeros((24, 32, 4), np.float32)
    rgba[:, 9] = (1.0, 0.0, 0.0, 1.0)  # the right one of the luma columns of chroma column 4
    got.picture.composite_over(Box(0, 0, 32, 24), rgba)
    change = np.abs(planes(got.picture.frame)[2].astype(int) - before[2])[:, 4]
    red = np.abs(RED_CR - before[2].astype(int))[:, 4]
    # Its share is half where chroma lies between the two, a quarter where it lies on the left one.
    assert np.median(change / np.maximum(red, 1)) == pytest.approx(
        0.5 if centred else 0.25, abs=0.05
    )


@pytest.mark.parametrize("primaries", [1, 9])  # BT.709, BT.2020
def test_patches_are_the_green_light_of_their_boxes(primaries):
    frame = noise_frame(37, 27, "yuv420p")
    frame.color_primaries = primaries
    picture = AvPicture(frame, orientation=Orientation(90))
    corners = [(0, 0), (27 - 9, 37 - 9), (3, 8)]
    boxes = [Box(x, y, x + 9, y + 9) for x, y in corners]
    green = [picture.linear(box)[..., 1] for box in boxes]
    np.testing.assert_array_equal(picture.green_patches(corners, 9), green)
    with pytest.raises(ValueError, match="does not lie inside the frame of 27x37"):
        picture.green_patches([*corners, (19, 0)], 9)


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p10le", "gbrp", "rgba", "gray"])
def test_opaque_layer_replaces_the_plate(pixel_format):
    picture = AvPicture(noise_frame(32, 24, pixel_format))
    rgba = np.full((24, 32, 4), 0.25, np.float32)
    rgba[..., 3] = 1.0
    picture.composite_over(Box(0, 0, 32, 24), rgba)
    light = picture.linear(Box(0, 0, 32, 24))
    np.testing.assert_allclose(light, 0.25, atol=0.012)


def test_rotated_picture_is_composited_in_display_orientation():
    frame = av.VideoFrame(32, 24, "gray")
    for plane in frame.planes:
        plane.update(bytes(plane.buffer_size))
    picture = AvPicture(frame, orientation=Orientation(90))
    assert (picture.width, picture.height) == (24, 32)
    picture.composite_over(Box(0, 0, 1, 1), np.ones((1, 1, 4), np.float32))
    stored = planes(frame)[0]
    assert np.argwhere(stored).tolist() == [[0, 31]]  # turned left, the right column is on top


@pytest.mark.parametrize(
    ("curve", "floats", "peak"),
    [
        ("bt709", False, 1.0), ("iec61966-2-1", True, 1.0), ("linear", False, 1.0),
        ("linear", True, np.inf), ("arib-std-b67", False, 3.774), ("smpte2084", False, 10000 / 203),
    ],
)  # fmt: skip
def test_peak_is_the_light_of_the_largest_code_and_light_itself_has_none(curve, floats, peak):
    samples = np.zeros((2, 2, 3), np.float32 if floats else np.uint16)
    assert ArrayPicture(samples, "rgb", replace(SRGB, transfer=curve)).peak == pytest.approx(
        peak, rel=1e-3
    )


def test_straight_alpha_of_the_plate_is_kept():
    array = np.zeros((2, 2, 4), np.uint8)
    array[..., 3] = 128
    rgba = np.full((2, 2, 4), 0.5, np.float32)
    ArrayPicture(array).composite_over(Box(0, 0, 2, 2), rgba)
    expected = 0.5 + 0.5 * 128 / 255
    assert np.abs(array[..., 3] / 255 - expected).max() < 0.003
    light = 0.5 / expected
    coded = 1.055 * light ** (1 / 2.4) - 0.055
    assert np.abs(array[..., 0] / 255 - coded).max() < 0.003


def test_associated_alpha_of_the_plate_is_kept():
    array = np.full((2, 2, 4), (0.25, 0.25, 0.25, 0.5), np.float32)
    rgba = np.full((2, 2, 4), (0.2, 0.2, 0.2, 0.5), np.float32)
    ArrayPicture(array, "rgb", LINEAR, associated=True).composite_over(Box(0, 0, 2, 2), rgba)
    np.testing.assert_allclose(array[..., :3], 0.325, rtol=1e-4)
    np.testing.assert_allclose(array[..., 3], 0.75, rtol=1e-6)


@pytest.mark.parametrize("associated", [False, True])
def test_fast_blend_agrees_with_the_reference_on_floats_with_alpha(associated):
    array = layer(24, 32, seed=5)  # where it has no alpha, associated colour is a glow
    array[4:8, :, 3] = 0.0
    fast, slow = (array_samples(array.copy(), "rgb", LINEAR, associated=associated) for _ in "ab")
    box = Box(0, 0, 32, 24)
    blend.composite_over(fast, box, layer(24, 32))
    blend_ref.composite_over(slow, box, layer(24, 32))
    for one, other in zip((*fast.planes, fast.alpha), (*slow.planes, slow.alpha), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-5)


def test_associated_alpha_of_coded_colours_is_refused():
    with pytest.raises(ValueError, match="needs linear light"):
        ArrayPicture(np.zeros((2, 2, 4), np.uint8), associated=True)


def test_opencv_channel_order_is_blue_first():
    array = np.zeros((1, 1, 3), np.uint8)
    ArrayPicture(array).composite_over(Box(0, 0, 1, 1), np.array([[[1, 0, 0, 1]]], np.float32))
    assert array.tolist() == [[[0, 0, 255]]]


def test_srgb_arrays_are_unchanged_without_a_layer():
    array = np.arange(256, dtype=np.uint8).repeat(3).reshape(16, 16, 3)
    np.testing.assert_allclose(ArrayPicture(array, "rgb").srgb(), array / 255.0, atol=2e-5)


def test_code_values_above_nominal_white_are_kept_beside_the_object():
    frame = av.VideoFrame(16, 16, "yuv420p")
    frame.planes[0].update(bytes([250]) * frame.planes[0].buffer_size)
    for plane in frame.planes[1:]:
        plane.update(bytes([128]) * plane.buffer_size)
    rgba = np.zeros((16, 16, 4), np.float32)
    rgba[4:8, 4:8, 3] = 1e-4  # a trace of shadow darkens by less than a code
    AvPicture(frame).composite_over(Box(0, 0, 16, 16), rgba)
    assert set(np.unique(planes(frame)[0])) == {250}


@pytest.mark.parametrize("packed", ["nv12", "nv16", "nv24", "p010le", "yuyv422", "uyvy422"])
def test_packed_formats_are_unpacked_without_loss(packed):
    plain = noise_frame(32, 24, working_format(packed))
    picture = AvPicture(plain.reformat(format=packed))
    for old, new in zip(planes(plain), planes(picture.frame), strict=True):
        np.testing.assert_array_equal(old, new)


def test_pixels_outside_the_frame_are_refused():
    picture = AvPicture(noise_frame(16, 16, "yuv420p"))
    with pytest.raises(ValueError, match="inside the frame"):
        picture.composite_over(Box(8, 8, 20, 20), np.zeros((12, 12, 4), np.float32))


def test_array_that_is_not_a_picture_is_refused():
    with pytest.raises(InputError, match="expected"):
        ArrayPicture(np.zeros((4, 4, 2), np.uint8))


def bars(matrix, full, bits):
    """75 % colour bars in 4:4:4 by the textbook formula, and the RGB they stand for."""
    kr, kb = (0.2126, 0.0722) if matrix == 1 else (0.299, 0.114)
    colours = [(r, g, b) for g in (0.75, 0) for r in (0.75, 0) for b in (0.75, 0)]
    rgb = np.repeat(np.array(colours)[None], 8, axis=0).repeat(4, axis=1)
    luma = rgb @ [kr, 1 - kr - kb, kb]
    cb, cr = (rgb[..., 2] - luma) / (2 - 2 * kb), (rgb[..., 0] - luma) / (2 - 2 * kr)
    unit, peak = 1 << (bits - 8), (1 << bits) - 1
    y = luma * peak if full else (16 + 219 * luma) * unit
    chroma = [128 * unit + part * (peak if full else 224 * unit) for part in (cb, cr)]
    return rgb, np.round(np.stack([y, *chroma])).astype(np.uint16 if bits > 8 else np.uint8)


@pytest.mark.parametrize("bits", [8, 10])
@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("matrix", [1, 6])
def test_colour_bars_are_decoded_within_a_code_value(matrix, full, bits):
    rgb, yuv = bars(matrix, full, bits)
    frame = av.VideoFrame(yuv.shape[2], yuv.shape[1], "yuv444p" if bits == 8 else "yuv444p10le")
    for plane, codes in zip(frame.planes, yuv, strict=True):
        padded = np.zeros((plane.height, plane.line_size // codes.itemsize), codes.dtype)
        padded[:, : plane.width] = codes
        plane.update(padded.tobytes())
    frame.colorspace, frame.color_range, frame.color_trc = matrix, 2 if full else 1, 13
    # Half a code of Y and half a code of Cb or Cr, the most that rounding has taken, come to 1.6.
    np.testing.assert_allclose(AvPicture(frame).srgb(), rgb, atol=1.6 / ((1 << bits) - 1))


def test_object_is_converted_to_the_primaries_of_a_bt2020_plate():
    tags = ColorTags(matrix="bt2020nc", transfer="smpte2084", primaries="bt2020", full_range=False)
    picture = AvPicture(noise_frame(16, 16, "yuv444p10le"), tags)
    rgba = np.zeros((16, 16, 4), np.float32)
    rgba[..., :] = (0.8, 0.1, 0.1, 1.0)
    picture.composite_over(Box(0, 0, 16, 16), rgba)
    light = picture.linear(Box(4, 4, 5, 5))[0, 0]
    np.testing.assert_allclose(light, [0.8, 0.1, 0.1], atol=0.012)


def test_sample_tables_have_the_layout_that_kernels_read():
    assert (kernels.STEPS_BITS, kernels.FIRST_OCTAVE) == (STEPS_BITS, FIRST_OCTAVE)


def test_samples_that_are_no_number_are_black_and_infinite_ones_white_but_stay_in_the_plate():
    plate = np.full((2, 4, 3), 0.5, np.float32)
    plate[0, :3] = np.array([np.nan, np.inf, -np.inf])[:, None]
    picture = ArrayPicture(plate)
    light = picture.linear(Box(0, 0, 4, 2))
    np.testing.assert_allclose(light[0, :3, 0], [0.0, 1.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(
        light, blend_ref.linear(picture.samples(), Box(0, 0, 4, 2)), rtol=2e-4, atol=2e-5
    )
    assert np.isfinite(picture.downsample(2, 1)).all()
    layer_ = np.zeros((2, 4, 4), np.float32)
    layer_[1] = (0.1, 0.1, 0.1, 1.0)
    picture.composite_over(Box(0, 0, 4, 2), layer_)
    assert np.isnan(plate[0, 0]).all() and np.isinf(plate[0, 1:3]).all()
    assert np.isfinite(plate[1]).all()


@pytest.mark.parametrize(
    "curve", ["bt709", "smpte170m", "smpte240m", "gamma28", "iec61966-2-1", "bt2020-10"]
)
def test_players_show_codes_of_video_as_those_of_srgb(curve):
    codes = np.random.default_rng(0).integers(0, 65536, (9, 14, 3), np.uint16)
    picture = ArrayPicture(codes, "rgb", replace(SRGB, transfer=curve))
    np.testing.assert_allclose(picture.shown(), codes / 65535.0, atol=2e-5)


@pytest.mark.parametrize("curve", ["linear", "smpte2084", "arib-std-b67"])
def test_players_show_hdr_and_linear_light_by_its_light(curve):
    codes = np.random.default_rng(0).integers(0, 65536, (9, 14, 3), np.uint16)
    picture = ArrayPicture(codes, "rgb", replace(SRGB, transfer=curve))
    np.testing.assert_array_equal(picture.shown(), picture.srgb())
