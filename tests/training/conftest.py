"""What several trainings draw from, and how each is resumed."""

import cv2
import numpy as np
import pytest


@pytest.fixture(scope="session")
def photos(tmp_path_factory):
    """A folder of photographs: sharp noise."""
    from models.coc.textures import Photos, noise

    folder = tmp_path_factory.mktemp("photos")
    (folder / "sharp").mkdir()
    rng = np.random.default_rng(5)
    for index in range(6):
        code = np.uint8(np.clip(128 + 40 * noise(rng, 900, 0.7), 0, 255))
        cv2.imwrite(str(folder / "sharp" / f"{index}.png"), np.repeat(code[..., None], 3, -1))
    return Photos.load(folder, held_out=False)


@pytest.fixture
def resume(tmp_path):
    """Trains a run by some steps, and lets a fresh one go on from its checkpoint."""

    def train(run, fresh, data, steps):
        def weights():
            return np.concatenate(
                [one.detach().cpu().numpy().ravel() for one in run.network.parameters()]
            )

        before = weights()
        assert np.isfinite([float(run.advance(data)) for _ in range(steps)]).all()
        assert (weights() != before).any()
        run.save(tmp_path / "checkpoint.pt")
        fresh.load(tmp_path / "checkpoint.pt")
        assert (fresh.step, fresh.trained_s) == (steps, run.trained_s)

    return train
