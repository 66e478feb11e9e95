"""The scatter's kernels in C++: all levels give the same bits, none reads beyond a table."""

import numpy as np
import pytest
from support.native_levels import assert_same_bits

from nlens_video.core.optics import ROUND, Aperture
from nlens_video.kernels.scatter import extend, levels, normalize, paper_scatter, scatter

MODULES = (extend, levels, normalize, paper_scatter, scatter)


def made_layer(seed=0, size=(60, 75), largest=40.0):
    """A ragged object of any colours with coverage of any kind, whose CoC steps and ramps."""
    rng = np.random.default_rng(seed)
    rgba = rng.random((*size, 4), dtype=np.float32)
    rgba[..., 3] = np.clip(2.0 * rgba[..., 3] - 0.5, 0.0, 1.0)
    rgba[:10] = rgba[-15:] = rgba[:, :12] = 0.0
    coc = np.linspace(-largest, largest, size[1], dtype=np.float32) + np.zeros(size, np.float32)
    coc[30:] *= 0.25
    return rgba, coc


def at_level(monkeypatch, module):
    for caller in MODULES:
        monkeypatch.setattr(caller, "kernels", module)


@pytest.mark.parametrize("detail", [scatter.FINE, scatter.DRAFT], ids=["fine", "draft"])
@pytest.mark.parametrize(
    "aperture",
    [ROUND, Aperture(blades=7), Aperture(blades=6, cat_eye=0.8), Aperture(cat_eye=1.0)],
    ids=["round", "blades", "blades with a cat's eye", "cat's eye"],
)
def test_scatter_is_the_same_at_every_level(monkeypatch, aperture, detail):
    rgba, coc = made_layer()

    def run(module):
        at_level(monkeypatch, module)
        blurred = scatter.scatter(rgba, coc, aperture=aperture, detail=detail, pixel_aspect=1.2)
        assert blurred[..., 3].max() > 0.5
        return [blurred]

    assert_same_bits(run)


def test_the_papers_scatter_is_the_same_at_every_level(monkeypatch):
    rgba, coc = made_layer(largest=12.0)

    def run(module):
        at_level(monkeypatch, module)
        return paper_scatter.paper_scatter(rgba[..., :3], np.abs(coc))

    assert_same_bits(run)


def followed_by_nan(table):
    room = np.full(2 * table.size, np.nan, np.float32)
    room[: table.size] = table.ravel()
    return room[: table.size].reshape(table.shape)


def test_nothing_beyond_a_table_is_read(monkeypatch):
    # stamps are looked up for all pixels of a row: large discs, of no weight there, have no entry
    rgba, coc = made_layer(largest=30.0)
    plain, made = scatter.scatter(rgba, coc, detail=scatter.DRAFT), scatter._tables

    def guarded(*arguments):
        discs = made(*arguments)
        return discs._replace(
            stamps=followed_by_nan(discs.stamps), spans=followed_by_nan(discs.spans)
        )

    monkeypatch.setattr(scatter, "_tables", guarded)
    np.testing.assert_array_equal(scatter.scatter(rgba, coc, detail=scatter.DRAFT), plain)


def test_rows_of_no_pixels_that_take_part_are_empty():
    rgba, coc = made_layer()
    rgba[:, :, 3] = 0.0
    assert not scatter.scatter(rgba, coc).any()
