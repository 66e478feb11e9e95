"""Small scenes of cards, and the four quality levels that blur them."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from support.glb_builder import QUAD_FACES, QUAD_UV, GlbBuilder

from nlens_video.core.layers import BlurredLayer, Box
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.motion_blur import mean_layer
from nlens_video.kernels.scatter.scatter import (
    DRAFT,
    FINE,
    blur_reach,
    scatter,
)
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxRepairNetwork
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Camera, Scene
from nlens_video.stages.l_depth_order import RepairDepthOrder
from nlens_video.stages.l_lens_sampling import (
    COVERAGE_DRAWS,
    BlurCell,
    LensSetup,
    SampleLens,
    shifted_cameras,
)
from nlens_video.stages.l_reblur import ReblurLayer, depth_peel, object_coc
from nlens_video.stages.l_view_blend import SampleSmallDiscs

WIDTH, HEIGHT, FOCAL = 112, 88, 100.0
FRAME = Box(0, 0, WIDTH, HEIGHT)
QUALITIES = ("draft", "realtime", "standard", "lens")
VIEWS = 16  # of the sampled lens: what its accuracy of 50 dB takes
MARGIN = 60


@dataclass(frozen=True, slots=True)
class Card:
    """A rectangle that faces the camera; place and half size as the frame shows them [px]."""

    depth: float
    at: tuple[float, float] = (0.0, 0.0)
    half: tuple[float, float] = (18.0, 14.0)
    seed: int = 0
    gain: float = 1.0


def cards(*shown: Card, lean: float = 0.0) -> Scene:
    """A scene of unlit, textured cards; `lean` is depth by unit to the right."""
    builder = GlbBuilder()
    for card in shown:
        rng = np.random.default_rng(card.seed)
        tiles = np.kron(rng.integers(40, 236, (6, 6, 3)), np.ones((8, 8, 1)))
        texture = {"index": builder.texture(tiles, magFilter=9729, minFilter=9987)}
        factor = [card.gain] * 3 + [1.0]
        paint = builder.add(
            "materials",
            {
                "pbrMetallicRoughness": {"baseColorTexture": texture, "baseColorFactor": factor},
                "extensions": {"KHR_materials_unlit": {}},
                "doubleSided": True,
            },
        )
        x, y = card.at
        size = np.array([card.half[0], card.half[1], 0.0]) * card.depth / FOCAL
        corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * size
        corners += [x * card.depth / FOCAL, -y * card.depth / FOCAL, -card.depth]
        corners[:, 2] -= lean * corners[:, 0]
        builder.node(
            mesh=builder.mesh(
                corners.astype(np.float32), QUAD_FACES, material=paint, TEXCOORD_0=QUAD_UV
            )
        )
    with tempfile.TemporaryDirectory() as folder:
        return Scene.load(builder.write(Path(folder) / "cards.glb"))


def camera(shift: tuple[int, int] = (0, 0)) -> Camera:
    """Looks along -Z from the origin; `shift` moves its picture by whole pixels."""
    return Camera(
        world_from_camera=np.eye(4),
        fx=FOCAL,
        fy=FOCAL,
        cx=WIDTH / 2 + shift[0],
        cy=HEIGHT / 2 + shift[1],
        width=WIDTH,
        height=HEIGHT,
    )


def lens_at(focus_depth: float, at_infinity_px: float) -> LensFit:
    """In focus at a depth; so large a CoC at infinity."""
    return LensFit(
        slope=at_infinity_px * focus_depth, intercept=-at_infinity_px, width=WIDTH, height=HEIGHT
    )


def lens_of_coc(coc_px: float, depth: float) -> LensFit:
    """Gives one CoC to a depth, whatever its sign, with as little change over depth as can be."""
    slope = max(coc_px, 0.0) * depth + 2.0 * depth
    return LensFit(slope=slope, intercept=coc_px - slope / depth, width=WIDTH, height=HEIGHT)


def whole(blurred: BlurredLayer) -> np.ndarray:
    """A layer on the whole frame (H, W, 4)."""
    out = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    out[blurred.box.slices_in(FRAME)] = blurred.rgba
    return out


def sharp(scene: Scene, view: Camera | None = None) -> np.ndarray:
    """The scene without any lens, on the whole frame (H, W, 4)."""
    with SoftwareObjectRenderer(scene) as renderer:
        layer = renderer.render(0.0, view or camera())
    box = layer.box.intersection(FRAME)
    return whole(BlurredLayer(box=box, rgba=layer.rgba[box.slices_in(layer.box)]))


def drawn(quality: str, scene: Scene) -> np.ndarray:
    """What a quality level blurs, on the whole frame (H, W, 4).

    The sharp picture; that of `lens` is the mean of pictures that are shifted by parts of a pixel.
    """
    if quality != "lens":
        return sharp(scene)
    shifted = [sharp(scene, view) for view in shifted_cameras(camera(), COVERAGE_DRAWS)]
    return np.mean(shifted, axis=0, dtype=np.float64).astype(np.float32)


def through(
    quality: str, scene: Scene, fit: LensFit, view: Camera | None = None, threads: int | None = None
) -> np.ndarray:
    """The scene through a lens, as a quality level makes it, on the whole frame (H, W, 4)."""
    view = view or camera()
    detail = DRAFT if quality == "draft" else FINE
    spread = ReblurLayer(
        scatter=lambda *given, **named: scatter(*given, threads=threads, detail=detail, **named),
        reach=lambda *given: blur_reach(*given, detail=detail),
    )
    with SoftwareObjectRenderer(scene, threads=threads) as renderer:
        layer = renderer.render(0.0, view, MARGIN)
        if layer is None:
            return np.zeros((HEIGHT, WIDTH, 4), np.float32)
        centre, few = object_coc(layer, fit), None
        shot = LensSetup(time_s=0.0, camera=view, fit=fit, frame=FRAME)
        if quality == "lens":
            stage = SampleLens(
                renderer=renderer, whole=spread, mean=mean_layer, cell=BlurCell(spread), count=VIEWS
            )
            return whole(stage(centre, shot))
        if quality == "standard":
            depth = float(layer.depth[np.isfinite(layer.depth)].max())
            centre = depth_peel(centre, fit, depth, renderer)
            few = SampleSmallDiscs(renderer=renderer)(centre, shot)
    blurred = spread(centre, FRAME)
    if quality == "standard":
        blurred = repair()(centre, blurred)
    return whole(blurred if few is None else few.blend_into(blurred))


@cache
def repair() -> RepairDepthOrder:
    """The repair as the preset `standard` has it."""
    network = OnnxRepairNetwork(find_model("reblur").path)
    return RepairDepthOrder(network=network, scatter=scatter, reach=blur_reach)


def spread_px(rgba: np.ndarray) -> float:
    """How wide the coverage lies: root of its second moment about its centre [px]."""
    alpha = rgba[..., 3].astype(np.float64)
    rows, columns = np.mgrid[: alpha.shape[0], : alpha.shape[1]]
    mass = alpha.sum()
    y, x = (alpha * rows).sum() / mass, (alpha * columns).sum() / mass
    return float(np.sqrt((alpha * ((rows - y) ** 2 + (columns - x) ** 2)).sum() / mass))


def both(*of: Sequence[Card]) -> tuple[Card, ...]:
    return tuple(card for some in of for card in some)
