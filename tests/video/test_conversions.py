"""Plates in other pixel formats, ranges and depths: no mean error, white and black exact."""

import av
import cv2
import numpy as np
import pytest
from support.clips import copy, write_clip

from nlens_video.core.color import ColorTags
from nlens_video.video.input.source import open_source
from nlens_video.video.pixels.conversion import converted
from nlens_video.video.pixels.picture import picture_frame
from nlens_video.video.pixels.pixel_formats import layout
from nlens_video.video.pixels.samples import Coding, plane_rows

WIDTH, HEIGHT = 2047, 9
LIMITED, FULL = 1, 2
RAMP = np.rint(np.linspace(0, 65535, WIDTH)) / 65535
COLOURS = np.stack([RAMP, RAMP[::-1], np.rint((0.25 + 0.5 * RAMP) * 65535) / 65535], axis=1)
GREYS = np.repeat(RAMP[:, None], 3, axis=1)


def coding(pixel_format, range_=LIMITED, matrix="bt709"):
    kind = layout(pixel_format)
    yuv = kind.family == "yuv"
    grey = len(kind.components) - kind.alpha == 1
    tags = ColorTags(
        matrix=matrix if yuv else "gbr", transfer="bt709", primaries="bt709",
        full_range=not yuv or range_ == FULL,
    )  # fmt: skip
    return Coding("gray" if grey else "yuv" if yuv else "rgb", tags, kind.bits)


def components(frame):
    """The samples of a frame, one array (h, w) a component."""
    kind = layout(frame.format.name)
    return [
        plane_rows(frame.planes[plane], kind)[:, place :: kind.channels]
        for plane, place in kind.components
    ]


def true_codes(rgb, form):
    """Codes (WIDTH, 3) of colours, not rounded; of grey its own."""
    if form.family == "gray":
        return rgb * form.peak
    affine = form.rgb_from_codes
    return np.linalg.solve(affine[:, :3], (rgb - affine[:, 3]).T).T


def stored(rgb, pixel_format, range_=LIMITED):
    """A frame whose columns have these colours."""
    form, kind = coding(pixel_format, range_), layout(pixel_format)
    frame = av.VideoFrame(WIDTH, HEIGHT, pixel_format)
    codes = np.rint(true_codes(rgb, form))
    for number, samples in enumerate(components(frame)):
        alpha = kind.alpha and number == len(kind.components) - 1
        samples[...] = (
            form.peak if alpha else codes[:: 1 if samples.shape[1] == WIDTH else 2, number]
        )
    frame.colorspace, frame.color_primaries, frame.color_trc = 1, 1, 1
    frame.color_range = range_ if form.family == "yuv" else FULL
    return frame


def plate(path, rgb, pixel_format, range_=LIMITED):
    """A plate whose file holds these colours without loss."""
    if path.suffix == ".png":
        deep = np.rint(rgb * 65535).astype(np.uint16)[None].repeat(HEIGHT, 0)
        cv2.imwrite(str(path), deep[..., 0] if pixel_format == "gray16be" else deep[..., ::-1])
        return path
    return write_clip(path, [stored(rgb, pixel_format, range_)])


def decoded(path):
    """The first frame, in its working format, and the range it says."""
    with open_source(str(path)) as source:
        frame = next(iter(source)).picture.frame
        return frame, frame.color_range


def errors(path, rgb, matrix="bt709"):
    """Errors of the codes of a file, one row a component, in its own codes."""
    frame, range_ = decoded(path)
    form = coding(frame.format.name, range_, matrix)
    true = true_codes(rgb, form)
    shown = 1 if form.family == "gray" else 3
    found = []
    for number, samples in enumerate(components(frame)[:shown]):
        middle = samples[HEIGHT // 4].astype(float)
        step = 1 if middle.size == WIDTH else 2
        found.append((middle - true[::step, number])[4:-4])
    return found, form


def white(path):
    """The first component of the first and the last column."""
    frame, _ = decoded(path)
    row = components(frame)[0][HEIGHT // 2]
    return int(row[0]), int(row[-1])


@pytest.mark.parametrize(
    ("pixel_format", "ends"),
    [
        ("yuv420p", (16, 235)), ("yuv444p", (16, 235)), ("yuv420p10le", (64, 940)),
        ("yuv422p10le", (64, 940)), ("yuv444p12le", (256, 3760)), ("yuv444p16le", (4096, 60160)),
        ("gbrp10le", (0, 1023)), ("gbrp12le", (0, 4095)), ("bgra", (0, 255)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("rgb", [GREYS, COLOURS], ids=["greys", "colours"])
def test_plate_of_16_bit_rgb_has_no_mean_error_in_video(tmp_path, pixel_format, ends, rgb):
    source = plate(tmp_path / "in.png", rgb, "rgb48be")
    copy(source, tmp_path / "out.mkv", codec="ffv1", pix_fmt=pixel_format)
    found, _ = errors(tmp_path / "out.mkv", rgb)
    for one in found:
        assert abs(one.mean()) < 0.03
        assert np.abs(one).max() < 0.6
    if rgb is GREYS:
        assert white(tmp_path / "out.mkv") == ends


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p10le", "yuv444p10le"])
def test_plate_of_16_bit_grey_has_no_mean_error_in_video(tmp_path, pixel_format):
    source = plate(tmp_path / "in.png", GREYS, "gray16be")
    copy(source, tmp_path / "out.mkv", codec="ffv1", pix_fmt=pixel_format)
    found, _ = errors(tmp_path / "out.mkv", GREYS)
    assert all(abs(one.mean()) < 0.03 and np.abs(one).max() < 0.6 for one in found)


@pytest.mark.parametrize("ending", ["png", "tif"])
def test_white_of_a_16_bit_picture_is_white_in_prores(tmp_path, ending):
    path = tmp_path / f"in.{ending}"
    cv2.imwrite(str(path), np.full((32, 64, 3), 65535, np.uint16))
    copy(path, tmp_path / "out.mov", codec="prores_ks", pix_fmt="yuv422p10le")
    frame, _ = decoded(tmp_path / "out.mov")
    assert [int(np.median(one)) for one in components(frame)] == [940, 512, 512]


@pytest.mark.parametrize(
    ("pixel_format", "range_"),
    [
        ("yuv420p", LIMITED), ("yuv420p10le", LIMITED), ("yuv422p10le", FULL),
        ("yuv444p10le", FULL), ("yuv444p12le", LIMITED), ("yuv444p16le", LIMITED),
    ],
)  # fmt: skip
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("out_%d.png", {"pix_fmt": "rgb48be"}), ("out_%d.tif", {"pix_fmt": "rgb48le"}),
        ("out.mkv", {"codec": "ffv1", "pix_fmt": "gbrp10le"}),
        ("out.mkv", {"codec": "ffv1", "pix_fmt": "gbrp16le"}),
        ("out.mkv", {"codec": "ffv1", "pix_fmt": "bgra"}),
    ],
)  # fmt: skip
def test_deep_yuv_has_no_mean_error_in_rgb(tmp_path, pixel_format, range_, name, options):
    copy(plate(tmp_path / "in.mkv", GREYS, pixel_format, range_), tmp_path / name, **options)
    source = np.rint(true_codes(GREYS, coding(pixel_format, range_)))
    affine = coding(pixel_format, range_).rgb_from_codes
    true = source @ affine[:, :3].T + affine[:, 3]
    result = tmp_path / name.replace("%d", "0")
    found, form = errors(result, np.clip(true, 0, 1))
    assert all(abs(one.mean()) < 0.05 and np.abs(one).max() < 0.6 for one in found)
    assert white(result) == (0, form.peak)


@pytest.mark.parametrize(
    ("own", "other"),
    [
        ("gbrp16le", "bgra"), ("gbrp10le", "bgra"), ("bgra", "gbrp10le"), ("bgra", "gbrap16le"),
        ("gbrp10le", "gbrp12le"), ("gbrp10le", "gbrp16le"), ("gbrp16le", "gray16le"),
        ("gray16le", "gbrp10le"), ("gray10le", "gray"), ("gray", "gray16le"),
    ],
)  # fmt: skip
def test_depth_of_rgb_and_grey_changes_without_mean_error(tmp_path, own, other):
    copy(plate(tmp_path / "in.mkv", GREYS, own), tmp_path / "out.mkv", codec="ffv1", pix_fmt=other)
    source = np.rint(GREYS * coding(own).peak) / coding(own).peak
    found, form = errors(tmp_path / "out.mkv", source)
    assert all(abs(one.mean()) < 0.03 and np.abs(one).max() < 0.6 for one in found)
    assert white(tmp_path / "out.mkv") == (0, form.peak)
    if layout(other).alpha:
        frame, _ = decoded(tmp_path / "out.mkv")
        assert (components(frame)[3] == form.peak).all()


@pytest.mark.parametrize(
    ("own", "other"), [("bgra", "gray"), ("bgra", "gray16le"), ("gbrp16le", "gray")]
)
def test_grey_of_rgb_is_its_luma_of_bt709(tmp_path, own, other):
    copy(
        plate(tmp_path / "in.mkv", COLOURS, own), tmp_path / "out.mkv", codec="ffv1", pix_fmt=other
    )
    frame, _ = decoded(tmp_path / "out.mkv")
    peak = coding(other).peak
    grey = components(frame)[0][HEIGHT // 2] / peak
    np.testing.assert_allclose(grey, COLOURS @ (0.2126, 0.7152, 0.0722), atol=1.1 / 255)


@pytest.mark.parametrize("pixel_format", ["yuvj420p", "yuvj444p"])
def test_colours_of_8_bit_rgb_have_no_mean_error_in_jpeg(tmp_path, pixel_format):
    frame = converted(stored(COLOURS, "bgra"), pixel_format)
    form = coding(pixel_format, FULL, "smpte170m")
    true = true_codes(np.rint(255 * COLOURS) / 255, form)
    for number, samples in enumerate(components(frame)):
        step = 2 if number and pixel_format == "yuvj420p" else 1
        exact = true[:-1, number].reshape(-1, step).mean(axis=1)  # chroma lies between two columns
        error = samples[HEIGHT // 4, : len(exact)] - exact
        assert abs(error.mean()) < 0.05
        assert np.abs(error).max() < 1.1


@pytest.mark.parametrize("own", ["yuv420p", "yuv444p", "yuv420p10le", "yuv422p10le"])
def test_full_range_becomes_limited_without_mean_error_of_colours(tmp_path, own):
    source = plate(tmp_path / "in.mkv", COLOURS, own, FULL)
    with open_source(str(source)) as opened:
        frame = picture_frame(next(iter(opened)).picture, own, limited=True)
    codes = [one.astype(float) for one in components(stored(COLOURS, own, FULL))]
    bits = layout(own).bits
    unit, peak = 2.0 ** (bits - 8), 2.0**bits - 1
    scales = (219 * unit / peak, 224 * unit / peak, 224 * unit / peak)
    middle = 128 * unit
    for number, (code, found) in enumerate(zip(codes, components(frame), strict=True)):
        zero = (0.0, 16 * unit) if number == 0 else (middle, middle)
        error = found - ((code - zero[0]) * scales[number] + zero[1])
        assert np.abs(error).max() < 0.51
        assert abs(error.mean()) < 0.06
    assert frame.color_range == LIMITED


@pytest.mark.parametrize("pixel_format", ["yuv422p10le", "yuv420p10le"])
def test_chroma_of_deep_rgb_lies_on_the_left_as_readers_take_it(tmp_path, pixel_format):
    source = plate(tmp_path / "in.png", COLOURS, "rgb48be")
    for name, chosen in (("full.mkv", "yuv444p16le"), ("out.mkv", pixel_format)):
        copy(source, tmp_path / name, codec="ffv1", pix_fmt=chosen)
    full, halved = (
        components(decoded(tmp_path / name)[0])[1][HEIGHT // 4].astype(float)
        for name in ("full.mkv", "out.mkv")
    )
    apart = halved - full[::2] / 64
    assert abs(apart[4:-4].mean()) < 0.02


@pytest.mark.parametrize("siting", ["left", "center", "topleft"])
def test_chroma_of_deep_plates_is_interpolated_where_they_say_it_lies(tmp_path, siting):
    frame = av.VideoFrame(128, 32, "yuv420p10le")
    frame.colorspace, frame.color_range, frame.color_primaries, frame.color_trc = 1, LIMITED, 1, 1
    luma, blue, red = components(frame)
    luma[...], red[...] = 500, 512
    columns = 2.0 * np.arange(blue.shape[1]) + (0.5 if siting == "center" else 0.0)
    blue[...] = 412 + 2 * columns
    options = {"chroma_sample_location": siting, "qp": "0"}
    source = write_clip(tmp_path / "in.mkv", [frame], codec="libx264", options=options)
    copy(source, tmp_path / "out.mkv", codec="ffv1", pix_fmt="gbrp16le")
    found = components(decoded(tmp_path / "out.mkv")[0])[2][16] / 65535
    affine = coding("yuv420p10le").rgb_from_codes
    cb = 412 + 2 * np.arange(128)
    true = affine[2] @ np.stack([np.full(128, 500.0), cb, np.full(128, 512.0), np.ones(128)])
    error = (found - true)[4:-4] / affine[2, 1]
    assert np.abs(error).max() < 0.05


def test_samples_of_rgb_of_the_same_depth_stay_bit_identical(tmp_path):
    source = plate(tmp_path / "in.mkv", COLOURS, "gbrp16le")
    copy(source, tmp_path / "out_%d.png", pix_fmt="rgb48be")
    before, after = (decoded(path)[0] for path in (source, tmp_path / "out_0.png"))
    order = [np.array(components(frame)) for frame in (before, after)]
    np.testing.assert_array_equal(*order)
