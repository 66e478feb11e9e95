"""Mattes and depth maps: real files through real codecs, frame by frame."""

import av
import cv2
import numpy as np
import pytest

from nlens_video.core.errors import InputError
from nlens_video.core.layers import DepthMap
from nlens_video.video.exr import write_layers
from nlens_video.video.input.holdout import open_holdout

SIZE = (64, 48)


def steps():
    """A staircase of grey from 0 to 255, 8 columns each."""
    return np.tile(np.repeat(np.linspace(0, 255, 8).round().astype(np.uint8), 8), (48, 1))


def png(path, pixels):
    assert cv2.imwrite(str(path), pixels)
    return str(path)


@pytest.mark.parametrize("kind", ["grey", "rgb", "16 bit", "opaque alpha"])
def test_holdout_coverage_is_the_pictures_luminance(tmp_path, kind):
    grey = steps()
    pixels = {
        "grey": grey,
        "rgb": cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR),
        "16 bit": grey.astype(np.uint16) * 257,
        "opaque alpha": cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA),
    }[kind]
    matte = open_holdout(png(tmp_path / "m.png", pixels), SIZE)
    assert "luminance" in matte.description
    coverage = matte.read(0).coverage
    assert coverage == pytest.approx(grey / 255.0, abs=2e-3)
    assert coverage.min() == 0.0 and coverage.max() == 1.0
    assert matte.read(7) is matte.read(0)  # a still serves all frames


def test_holdout_coverage_is_the_alpha_channel_if_present(tmp_path):
    pixels = np.full((48, 64, 4), 255, np.uint8)
    pixels[..., 3] = steps()
    matte = open_holdout(png(tmp_path / "m.png", pixels), SIZE)
    assert "alpha" in matte.description
    assert matte.read(0).coverage == pytest.approx(steps() / 255.0, abs=1e-6)


def write_video(path, values, codec="libx264", pix_fmt="yuv420p"):
    """One flat grey a frame, as the display code."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = *SIZE, pix_fmt
        for value in values:
            rgb = np.full((SIZE[1], SIZE[0], 3), value, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, "rgb24")))
        container.mux(stream.encode())
    return str(path)


def test_holdout_video_is_read_by_frame_with_exact_black_and_white(tmp_path):
    matte = open_holdout(write_video(tmp_path / "m.mp4", (0, 255, 128, 0, 255)), SIZE)
    assert matte.read(0).coverage.max() == 0.0
    assert matte.read(1).coverage.min() == 1.0
    assert matte.read(2).coverage.mean() == pytest.approx(128 / 255, abs=0.01)
    assert matte.read(2).coverage.mean() == pytest.approx(128 / 255, abs=0.01)  # asked for again
    assert matte.read(4).coverage.min() == 1.0  # frames may be left out
    with pytest.raises(InputError, match="ends before frame 5 of the plate; make it as long"):
        matte.read(5)
    matte.close()


def write_marked(folder, count=8):
    """Pictures of a matte, each white on eight columns of its own; the pattern of their names."""
    for number in range(count):
        grey = np.zeros((48, 64), np.uint8)
        grey[:, 8 * number : 8 * number + 8] = 255
        png(folder / f"m_{number + 1:04d}.png", grey)
    return str(folder / "m_%04d.png")


def write_marked_movie(folder, pattern, count=8):
    """The pictures as they are on disk, in a movie."""
    path = folder / "m.mov"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("png", rate=24)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "gray"
        for number in range(count):
            grey = cv2.imread(pattern % (number + 1), cv2.IMREAD_GRAYSCALE)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, "gray")))
        container.mux(stream.encode())
    return path


def damage(path, number):
    """Zeros in place of the beginning of a PNG in a file."""
    data = bytearray(path.read_bytes())
    starts = [at for at in range(len(data)) if data[at : at + 4] == b"\x89PNG"]
    data[starts[number] : starts[number] + 40] = bytes(40)
    path.write_bytes(data)


def white_parts(holdout, count=8):
    """The number of the white columns of each frame."""
    rows = [holdout.read(index).coverage[0] for index in range(count)]
    return [int(np.flatnonzero(row)[0]) // 8 for row in rows]


def write_damaged(folder, kind, frame):
    """The eight marked frames with one that no codec decodes."""
    spec = write_marked(folder)
    if kind == "png":
        damage(folder / f"m_{frame + 1:04d}.png", 0)
        return spec
    movie = write_marked_movie(folder, spec)
    damage(movie, frame)
    return str(movie)


@pytest.mark.parametrize("frame", [3, 7])
@pytest.mark.parametrize("kind", ["png", "mov"])
def test_damaged_matte_is_held_from_the_frame_before_and_shifts_no_other(tmp_path, kind, frame):
    holdout = open_holdout(write_damaged(tmp_path, kind, frame), SIZE)
    expected = list(range(8))
    expected[frame] = frame - 1
    assert white_parts(holdout) == expected
    (note,) = holdout.notes()
    assert "1 frame cannot be decoded: the matte of the frame before is held" in note
    holdout.close()


@pytest.mark.parametrize("kind", ["png", "mov"])
def test_mattes_may_be_asked_for_in_any_order(tmp_path, kind):
    spec = write_marked(tmp_path)
    spec = str(write_marked_movie(tmp_path, spec)) if kind == "mov" else spec
    holdout = open_holdout(spec, SIZE)
    order = [5, 2, 3, 0, 7, 7, 1]
    rows = [holdout.read(index).coverage[0] for index in order]
    assert [int(np.flatnonzero(row)[0]) // 8 for row in rows] == order
    holdout.close()


def test_matte_ends_where_its_file_does_though_a_frame_of_it_is_damaged(tmp_path):
    holdout = open_holdout(write_damaged(tmp_path, "mov", 7), SIZE)
    white_parts(holdout)
    with pytest.raises(InputError, match="ends before frame 8"):
        holdout.read(8)


@pytest.mark.parametrize("kind", ["png", "mov"])
def test_matte_whose_first_picture_is_damaged_is_refused(tmp_path, kind):
    spec = write_damaged(tmp_path, kind, 0)
    with pytest.raises(InputError, match="first picture cannot be decoded; make it again"):
        open_holdout(spec, SIZE)


def test_matte_that_changes_its_size_is_noted(tmp_path):
    spec = write_marked(tmp_path)
    png(tmp_path / "m_0004.png", np.zeros((24, 32), np.uint8))
    holdout = open_holdout(spec, SIZE)
    holdout.read(7)
    (note,) = holdout.notes()
    assert "from frame 3 on, 32x24" in note and "converted to 64x48" in note


def test_holdout_sequence_starts_at_its_smallest_number(tmp_path):
    for number in range(3):
        png(tmp_path / f"m_{number + 11:04d}.png", np.full((48, 64), 100 * number, np.uint8))
    matte = open_holdout(str(tmp_path / "m_%04d.png"), SIZE)
    shares = [float(matte.read(index).coverage.mean()) for index in range(3)]
    assert shares == pytest.approx([0, 100 / 255, 200 / 255], abs=1e-3)


@pytest.mark.parametrize("name", ["m.png", "m.exr"])
def test_holdout_of_another_size_is_refused_in_one_line(tmp_path, name):
    if name.endswith("png"):
        png(tmp_path / name, steps())
    else:
        write_layers(tmp_path / name, {"Z": np.ones((48, 64), np.float32)})
    with pytest.raises(InputError, match="64x48 pixels, the plate has 64x50; make the holdout"):
        open_holdout(str(tmp_path / name), (64, 50))


def test_exr_depth_holdout_treats_invalid_and_far_depth_as_infinite(tmp_path):
    depth = np.full((48, 64), 2.5, np.float32)
    depth[:, 32:], depth[0], depth[1] = 1e10, -1.0, np.nan
    write_layers(tmp_path / "z.exr", {"Z": depth, "A": np.ones_like(depth)})
    holdout = open_holdout(str(tmp_path / "z.exr"), SIZE)
    assert "Z is nearer" in holdout.description
    read = holdout.read(3)
    assert isinstance(read, DepthMap)
    assert (read.depth[2:, :32] == 2.5).all()
    assert np.isinf(read.depth[:, 32:]).all() and np.isinf(read.depth[:2]).all()


@pytest.mark.parametrize("depth", [-2.5, np.nan, 0.0])
def test_exr_depth_that_is_nowhere_positive_is_refused(tmp_path, depth):
    write_layers(tmp_path / "z.exr", {"Z": np.full((48, 64), depth, np.float32)})
    with pytest.raises(InputError, match="Z is nowhere positive; write the distance in front of"):
        open_holdout(str(tmp_path / "z.exr"), SIZE)


def test_exr_depth_sequence_may_have_frames_without_a_thing(tmp_path):
    for number, depth in enumerate((0.0, 2.5, 1e10, -2.5)):
        path = tmp_path / f"z_{number}.exr"
        write_layers(path, {"Z": np.full((48, 64), depth, np.float32)})
    holdout = open_holdout(str(tmp_path / "z_%d.exr"), SIZE)
    assert [float(holdout.read(index).depth.min()) for index in range(3)] == [np.inf, 2.5, np.inf]
    with pytest.raises(InputError, match="z_3.exr: Z is nowhere positive"):
        holdout.read(3)


@pytest.mark.parametrize("channels", ["A", "Y", "RGB", "RGBA"])
def test_holdout_matte_is_read_from_exr(tmp_path, channels):
    share = steps().astype(np.float32) / 255
    values = dict.fromkeys(channels, share)
    if channels == "RGBA":
        values |= dict.fromkeys("RGB", 0.3 * share)
    for number in range(2):
        write_layers(tmp_path / f"m_{number}.exr", {k: v / (1 + number) for k, v in values.items()})
    matte = open_holdout(str(tmp_path / "m_%d.exr"), SIZE)
    assert matte.read(0).coverage == pytest.approx(share, abs=2e-3)
    assert matte.read(1).coverage == pytest.approx(share / 2, abs=2e-3)
    with pytest.raises(InputError, match="ends before frame 2"):
        matte.read(2)


def test_gap_in_an_exr_holdout_is_named(tmp_path):
    for number in (1, 2, 4, 5):
        write_layers(tmp_path / f"z_{number:04d}.exr", {"Z": np.ones((48, 64), np.float32)})
    with pytest.raises(
        InputError, match=r"z_0003.exr: is missing, the sequence goes on with z_0004"
    ):
        open_holdout(str(tmp_path / "z_%04d.exr"), SIZE)


def test_matte_of_floats_in_tiff_is_not_called_damaged_alone(tmp_path):
    floats = png(tmp_path / "m.tif", np.ones((48, 64), np.float32))
    with pytest.raises(InputError, match="of floating point .write OpenEXR, or 16 bits."):
        open_holdout(floats, SIZE)


@pytest.mark.parametrize("kind", ["png", "exr"])
@pytest.mark.parametrize(("alphas", "told"), [((1.0, 0.5), 1), ((1.0, 1.0), 0), ((0.5, 1.0), 0)])
def test_alpha_that_the_first_frame_does_not_show_is_told(tmp_path, kind, alphas, told):
    for number, alpha in enumerate(alphas):
        rgba = np.full((48, 64, 4), alpha, np.float32)
        path = tmp_path / f"m_{number}.{kind}"
        if kind == "png":
            png(path, np.round(255 * rgba).astype(np.uint8))
        else:
            write_layers(path, {name: rgba[..., at] for at, name in enumerate("RGBA")})
    holdout = open_holdout(str(tmp_path / f"m_%d.{kind}"), SIZE)
    holdout.read(1)
    assert sum("read by its luminance" in note for note in holdout.notes()) == told


def test_invalid_holdout_is_refused_in_one_line(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        open_holdout(str(tmp_path / "none.png"), SIZE)
    write_layers(tmp_path / "m.exr", {"U": np.ones((48, 64), np.float32)})
    with pytest.raises(InputError, match="has no channel R .found U.; a holdout needs Z"):
        open_holdout(str(tmp_path / "m.exr"), SIZE)
