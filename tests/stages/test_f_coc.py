import subprocess
import sys

import numpy as np
import pytest

from nlens_video.core.errors import NlensError
from nlens_video.core.layers import CocMap
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxCocNetwork
from nlens_video.stages.f_coc import EstimateCoc, estimate_coc


class ColumnNetwork:
    """Answers with the column of each cell's centre, so that a shift by a pixel shows."""

    stride = 32

    def __call__(self, rgb):
        assert rgb.shape[0] % 32 == 0 and rgb.shape[1] % 32 == 0
        columns = np.arange(rgb.shape[1] // 4, dtype=np.float32) * 4 + 2
        coc = np.repeat(columns[None], rgb.shape[0] // 4, 0)
        return CocMap(coc_px=coc, sigma_px=np.ones_like(coc))


class TenPixels:
    stride = 32

    def __call__(self, rgb):
        cells = np.ones((rgb.shape[0] // 4, rgb.shape[1] // 4), np.float32)
        return CocMap(coc_px=10 * cells, sigma_px=cells)


class Still:
    def __init__(self, rgb):
        self._rgb = rgb

    @property
    def width(self):
        return self._rgb.shape[1]

    @property
    def height(self):
        return self._rgb.shape[0]

    def srgb(self):
        return self._rgb


@pytest.fixture(scope="module")
def network():
    with OnnxCocNetwork(find_model("coc").path) as network:
        yield network


def disc_blurred(linear, diameter):
    """Convolution with a disc drawn at 16 samples a pixel, on a torus."""
    size = linear.shape[0]
    reach, fine = int(diameter / 2) + 2, 16
    axis = (np.arange((2 * reach + 1) * fine) + 0.5) / fine - reach - 0.5
    disc = (axis[:, None] ** 2 + axis**2 <= diameter**2 / 4).astype(float)
    disc = disc.reshape(2 * reach + 1, fine, 2 * reach + 1, fine).mean((1, 3))
    kernel = np.zeros((size, size))
    kernel[: 2 * reach + 1, : 2 * reach + 1] = disc / disc.sum()
    kernel = np.roll(kernel, (-reach, -reach), (0, 1))
    spectrum = np.fft.rfft2(kernel)[..., None]
    return np.fft.irfft2(np.fft.rfft2(linear, axes=(0, 1)) * spectrum, (size, size), axes=(0, 1))


def noise_picture(diameter, seed=3, size=256):
    """A colourful noise of natural spectrum, blurred in linear light, 8-bit sRGB."""
    rng = np.random.default_rng(seed)
    fy, fx = np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)
    spectrum = np.fft.rfft2(rng.standard_normal((size, size)))
    field = np.fft.irfft2(spectrum / (np.hypot(fy, fx) + 1 / size) ** 0.8, (size, size))
    field = field / field.std()
    linear = np.clip(0.25 + 0.1 * field[..., None] * (1.0, 0.8, 0.6), 0, 1)
    code = np.clip(disc_blurred(linear, diameter), 0, 1) ** (1 / 2.2)
    return np.float32(np.round(255 * code) / 255)


def test_texture_blurred_by_a_known_disc_is_estimated_as_that_coc(network):
    for diameter in (4.0, 8.0, 16.0):
        coc = estimate_coc(network, noise_picture(diameter)).coc_px
        assert np.median(coc) == pytest.approx(diameter, rel=0.25), diameter


def test_flat_grey_has_a_large_expected_error_and_texture_a_small_one(network):
    flat = estimate_coc(network, np.full((256, 256, 3), 0.5, np.float32))
    textured = estimate_coc(network, noise_picture(8.0))
    relative = np.median(flat.sigma_px / (1 + flat.coc_px))
    assert relative > 3 * np.median(textured.sigma_px / (1 + textured.coc_px))


def test_coc_estimate_is_deterministic(network):
    picture = noise_picture(6.0)
    first, second = estimate_coc(network, picture), estimate_coc(network, picture)
    np.testing.assert_array_equal(first.coc_px, second.coc_px)
    np.testing.assert_array_equal(first.sigma_px, second.sigma_px)


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
def test_clipped_or_flat_areas_are_uncertain_and_not_sharp(network, value):
    picture = noise_picture(8.0, size=384)
    picture[120:264, 120:264] = value
    sigma = estimate_coc(network, picture).sigma_px
    assert np.median(sigma[160:224, 160:224]) > 10 * np.median(sigma[:90])


@pytest.mark.parametrize("shape", [(1, 1), (17, 31), (31, 1000), (33, 64), (270, 480)])
def test_coc_map_has_the_size_of_the_picture(network, shape):
    rgb = np.random.default_rng(0).random((*shape, 3), dtype=np.float32)
    result = EstimateCoc(network)(Still(rgb))
    assert result.coc_px.shape == result.sigma_px.shape == shape
    assert (result.coc_px >= 0).all() and (result.sigma_px > 0).all()
    assert np.isfinite(result.coc_px).all() and np.isfinite(result.sigma_px).all()


def test_coc_map_is_aligned_with_the_picture():
    for shape, scale in (((50, 70, 3), 2), ((40, 960, 3), 1), ((40, 1920, 3), 0.5)):
        result = estimate_coc(ColumnNetwork(), np.zeros(shape, np.float32))
        # a "diameter" that is the column seen by the network comes back as the frame's own column
        expected = np.arange(shape[1]) + 0.5
        edge = round(2 / scale) + 1
        seen = result.coc_px[20, edge:-edge]
        np.testing.assert_allclose(seen, expected[edge:-edge], atol=0.02 + 1e-4 * shape[1])


def test_small_frame_is_enlarged_up_to_twice_for_the_network():
    seen = []

    class Looking(TenPixels):
        def __call__(self, rgb):
            seen.append(rgb.shape)
            return super().__call__(rgb)

    for shape, factor in (((96, 160), 2), ((256, 480), 2), ((360, 640), 1.5), ((512, 960), 1)):
        result = estimate_coc(Looking(), np.zeros((*shape, 3), np.float32))
        height, width, _ = seen.pop()
        assert 0 <= height - shape[0] * factor < 32 and 0 <= width - shape[1] * factor < 32
        np.testing.assert_allclose(result.coc_px, 10 / factor, rtol=1e-6)


def test_coc_of_a_4k_frame_is_in_its_own_pixels():
    texture = np.random.default_rng(0).random((540, 960, 3), dtype=np.float32)
    result = estimate_coc(TenPixels(), texture.repeat(4, axis=0).repeat(4, axis=1))
    assert result.coc_px.shape == (2160, 3840)
    np.testing.assert_allclose(result.coc_px, 40.0, rtol=1e-6)
    np.testing.assert_allclose(result.sigma_px, 4.0, rtol=1e-6)


def test_invalid_picture_is_refused():
    for shape in [(8, 8), (8, 8, 4), (0, 8, 3)]:
        with pytest.raises(ValueError, match="must be"):
            estimate_coc(TenPixels(), np.zeros(shape, np.float32))


def test_closed_network_refuses_to_run():
    network = OnnxCocNetwork(find_model("coc").path)
    network.close()
    network.close()
    with pytest.raises(ValueError, match="closed"):
        network(np.zeros((32, 32, 3), np.float32))


def test_invalid_network_file_is_refused_in_one_line(tmp_path):
    path = tmp_path / "broken.onnx"
    path.write_bytes(b"not a network")
    with pytest.raises(NlensError, match=r"broken\.onnx.*cannot load") as caught:
        OnnxCocNetwork(path)
    assert "\n" not in str(caught.value)


def test_importing_the_coc_stage_loads_no_heavy_library():
    code = (
        "import sys, nlens_video.stages.f_coc, nlens_video.networks.model_store;"
        "print([m for m in ('onnxruntime', 'torch', 'av') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
