import numpy as np
import pytest


@pytest.mark.slow
def test_without_hard_grounds_a_seed_draws_the_picture_that_it_always_drew(photos):
    from models.coc.data import draw_picture
    from models.coc.scene import draw_scene

    (first, coc), (second, again) = (
        draw_picture(np.random.default_rng(3), photos, 0.0),
        draw_scene(np.random.default_rng(3), photos),
    )
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(coc, again)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_seed_determines_the_picture_of_a_long_ground(photos, seed):
    from models.coc.data import draw_picture
    from models.coc.scene import SIZE

    (first, coc), (second, again) = (
        draw_picture(np.random.default_rng(seed), photos, 1.0) for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(coc, again)
    assert first.shape == (SIZE, SIZE, 3) and first.dtype == np.uint8
    assert coc.shape == (SIZE, SIZE) and coc.min() >= 0 and coc.max() <= 64


@pytest.mark.parametrize("index", range(9))
def test_hard_surfaces_are_light_that_differs_from_pixel_to_pixel(index):
    from models.coc.grounds import GROUNDS

    assert len(GROUNDS) == 9
    code = GROUNDS[index][0](np.random.default_rng(index), 128)
    assert code.shape == (128, 128, 3) and np.isfinite(code).all()
    assert 0 < np.abs(np.diff(code, axis=1)).mean() < 0.5


def test_cells_belong_to_their_nearest_point():
    from models.coc.grounds import _cells

    index, distance = _cells(np.random.default_rng(0), 40, 8.0)
    points = {int(index[y, x]): (y, x) for y, x in np.argwhere(distance == 0)}
    assert set(points) == set(np.unique(index).tolist())
    y, x = np.mgrid[0:40, 0:40]
    to_own = np.array([points[int(i)] for i in index.ravel()]).reshape(40, 40, 2)
    own = np.hypot(y - to_own[..., 0], x - to_own[..., 1])
    nearest = np.min([np.hypot(y - at[0], x - at[1]) for at in points.values()], axis=0)
    assert (own - nearest).max() < 0.6  # the distance transform is that of a 5x5 mask


def test_texture_goes_on_as_its_mirror_image_without_end():
    from models.coc.scene import within

    places = np.float32([-25, -10, -9, -1, 0, 0.5, 9, 9.5, 10, 18, 27, 100])
    folded = np.float32([7, 8, 9, 1, 0, 0.5, 9, 8.5, 8, 0, 9, 8])
    np.testing.assert_allclose(within(places, 10), folded, atol=1e-5)


@pytest.fixture
def noise_ground(monkeypatch):
    """Draws a ground of noise that runs to a far wall, from a number of places a pixel."""
    from models.coc import scene

    size = 576
    rows = np.float32(np.arange(size) - (size - 1) / 2)[:, None] * np.ones((1, size), np.float32)
    layout = scene.Layout(np.maximum(1 + rows / 280, 0.05), 0.0, 0.0, (0.0, 1.0))
    texture = np.float32(np.random.default_rng(0).random((648, 648, 1)) * np.ones(3))
    monkeypatch.setattr(scene, "GRAINED_SHARE", 0.0)

    def draw(seed, most_taps=scene.MOST_TAPS):
        monkeypatch.setattr(scene, "MOST_TAPS", most_taps)
        return scene.in_perspective(np.random.default_rng(seed), layout, texture)[..., 0]

    return draw


def test_far_ground_is_not_smeared_beyond_its_texture(noise_ground):
    edge = noise_ground(1, most_taps=1)[70:130, :60]  # more than two textures from the middle
    for axis in (0, 1):
        assert np.abs(np.diff(edge, axis=axis)).mean() > 0.5 * edge.std()


@pytest.mark.parametrize("seed", [1, 8])
def test_far_ground_shows_nearly_the_mean_of_its_texture(noise_ground, seed):
    single, few, many = (noise_ground(seed, taps)[20:40] for taps in (1, 5, 64))
    assert few.std() < 0.5 * single.std() and few.std() < 4 * many.std()
    np.testing.assert_allclose(few.mean(), many.mean(), atol=0.002)


@pytest.mark.slow
def test_ground_that_mirrors_keeps_its_own_coc(photos, monkeypatch):
    from models.coc import long_ground
    from models.coc.scene import MARGIN, SIZE

    monkeypatch.setattr(long_ground, "GLOSSY_SHARE", 1.0)
    monkeypatch.setattr(long_ground, "STRANDS_SHARE", 0.0)
    monkeypatch.setattr(long_ground, "draw_things", lambda *_: [])
    inner = slice(MARGIN, MARGIN + SIZE)
    for seed in range(2):
        layout = long_ground.draw_ground_plane(np.random.default_rng(seed)).layout
        _, coc = long_ground.draw_long_ground(np.random.default_rng(seed), photos)
        np.testing.assert_array_equal(coc, np.abs(layout.coc(layout.disparity))[inner, inner])


def test_mirror_image_lies_beyond_the_ground(photos):
    from models.coc.long_ground import draw_ground_plane, mirrored

    for seed in range(3):
        rng = np.random.default_rng(seed)
        layout = draw_ground_plane(rng).layout
        image, share, coc = mirrored(rng, layout, photos)
        assert (coc <= layout.coc(layout.disparity) + 1e-4).all()  # signed: farther is less
        assert share.min() >= 0 and share.max() <= 0.85
        assert image.shape == (*share.shape, 3) and image.min() >= 0


def test_strands_have_the_disparity_of_their_feet():
    from models.coc.long_ground import draw_ground_plane, with_strands

    rng = np.random.default_rng(2)
    layout = draw_ground_plane(rng).layout
    bare = np.full((*layout.disparity.shape, 3), 0.9, np.float32)
    light, disparity = with_strands(rng, layout, bare)
    seen = disparity != layout.disparity
    assert seen.mean() > 0.05
    # They stand: what they hide lies farther away, but for the few that lean down.
    assert (disparity >= layout.disparity - 1e-6)[seen].mean() > 0.9
    assert (light[seen].max(-1) < 0.8).mean() > 0.9


def test_two_independent_lights_add_their_variances():
    from models.coc.long_ground import _together

    rng = np.random.default_rng(0)
    samples = [scale * rng.random((4000, 1, 3)) for scale in (1.0, 3.0)]
    parts = [np.concatenate([s.mean(0), (s**2).mean(0)], -1)[None] for s in samples]
    total = _together(*(np.float32(part) for part in parts))[0, 0]
    added = samples[0] + samples[1]
    np.testing.assert_allclose(total[:3], added.mean((0, 1)), rtol=1e-3)
    np.testing.assert_allclose(total[3:] - total[:3] ** 2, added.var((0, 1)), rtol=0.05)


def test_filmed_picture_keeps_a_step_in_its_place():
    from models.coc.degrade import filmed

    linear = np.full((96, 96, 3), 0.05, np.float32)
    linear[:, 48:] = 0.6
    for seed in range(6):
        picture = filmed(np.random.default_rng(seed), linear)
        assert picture.shape == linear.shape and picture.dtype == np.uint8
        profile = picture.mean((0, 2))
        middle = (profile[:32].mean() + profile[64:].mean()) / 2
        assert profile[:44].max() < middle < profile[53:].min()
