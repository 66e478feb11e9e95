"""Training on a GPU: a step of the optimiser is recorded once as a CUDA graph and replayed.

One step launches some thousand small kernels. Launched one by one, they keep the GPU waiting for
the CPU most of the time.
"""

from __future__ import annotations

import time
from pathlib import Path

import torch
from torch import Tensor

from models.coc.batches import Batches
from models.coc.network import laplace_loss
from models.coc.run import Recipe, Run

WARM_UP = 3  # steps before the recording, which wants the optimiser's state and chosen kernels


class RecordedRun(Run):
    """Training of the CoC network on a GPU; same weights, clock and checkpoints as `Run`."""

    compiled = True

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe, "cuda")
        self._rate = torch.zeros((), device=self.device)
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), self._rate, betas=self.BETAS, weight_decay=0.01,
            fused=True, capturable=True,
        )  # fmt: skip
        self._answer = torch.compile(self.network) if self.compiled else self.network
        self._crop = 0
        self._finished: torch.cuda.Event | None = None

    def advance(self, data: Batches) -> Tensor:
        """One optimiser step; returns the figure for the log."""
        start = time.perf_counter()
        crop = self.recipe.crop_at(self.progress)
        batch = data.draw(self.rng, crop, max(1, self.recipe.pixels // crop**2))
        self._rate.fill_(self.recipe.rate_at(self.progress, self.step))
        if crop != self._crop:
            self._record(*batch)
            self._crop = crop
        self._rgb.copy_(batch[0])
        self._coc.copy_(batch[1])
        self._graph.replay()
        if self._finished is not None:
            self._finished.synchronize()  # the clock waits for the GPU, one step behind
        self._finished = torch.cuda.Event()
        self._finished.record()
        self.step += 1
        self.trained_s += time.perf_counter() - start
        return self._shown.clone()

    def load(self, path: Path) -> None:
        """Resume from a checkpoint; the rate stays the tensor that the recording reads."""
        super().load(path)
        for group in self.optimiser.param_groups:
            group["lr"] = self._rate

    def _record(self, rgb: Tensor, coc: Tensor) -> None:
        """Record a step on batches of this size."""
        self._rgb = rgb.contiguous(memory_format=torch.channels_last).clone()
        self._coc = coc.clone()
        beside = torch.cuda.Stream()
        beside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(beside):
            for _ in range(WARM_UP):
                self._descend()
        torch.cuda.current_stream().wait_stream(beside)
        self.optimiser.zero_grad(set_to_none=True)
        self._graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(self._graph):
            self._shown = self._descend()

    def _descend(self) -> Tensor:
        self.optimiser.zero_grad(set_to_none=True)
        with torch.autocast("cuda", dtype=torch.bfloat16, cache_enabled=False):
            answer = self._answer(self._rgb)
        loss, likelihood = laplace_loss(answer, self._coc, self.recipe.beta)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self.optimiser.step()
        slow, fast = (list(n.parameters()) for n in (self.average, self.network))
        with torch.no_grad():
            torch._foreach_lerp_(slow, fast, 1 - self.EMA_DECAY)
        return likelihood.detach()
