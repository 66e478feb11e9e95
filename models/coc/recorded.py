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
from models.training import GRADIENT_NORM, WEIGHT_DECAY

WARM_UP = 3  # runs before the recording, which wants the optimiser's state and chosen kernels
ON_DEVICE = {"fused": True, "capturable": True}  # a recorded step cannot ask the CPU


class RecordedRun(Run):
    """Training of the CoC network on a GPU; schedule and checkpoints are those of `Run`.

    Compiling and recording a step, once for each size of the crops, count as no training time. They
    change no weight, but the optimiser's moments see that batch three times more.
    """

    def __init__(self, recipe: Recipe) -> None:
        super().__init__(recipe, "cuda")
        self._rate, self._follow = (torch.zeros((), device=self.device) for _ in range(2))
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), self._rate, betas=self.BETAS, weight_decay=WEIGHT_DECAY,
            **ON_DEVICE,
        )  # fmt: skip
        self._answer = torch.compile(self.network, dynamic=False)
        self._crop = 0
        self._finished: torch.cuda.Event | None = None

    def advance(self, data: Batches) -> Tensor:
        """One optimiser step; returns the batch's negative log-likelihood, on the GPU."""
        start = time.perf_counter()
        crop = self.recipe.crop_at(self.progress)
        batch = data.draw(self.rng, crop, max(1, self.recipe.pixels // crop**2))
        if crop != self._crop:
            before = time.perf_counter()
            self._record(*batch)
            self._crop = crop
            start += time.perf_counter() - before
        self._rgb.copy_(batch[0])
        self._coc.copy_(batch[1])
        self._rate.fill_(self.recipe.rate_at(self.progress, self.step))
        self._follow.fill_(1 - self.ema_decay_at(self.step))
        self._graph.replay()
        if self._finished is not None:
            self._finished.synchronize()  # the clock waits for the GPU, one step behind
        self._finished = torch.cuda.Event()
        self._finished.record()
        self.step += 1
        self.trained_s += time.perf_counter() - start
        return self._shown.clone()

    def load(self, path: Path) -> None:
        """Resume from a checkpoint, of a `Run` too."""
        super().load(path)
        for group in self.optimiser.param_groups:
            group.update(ON_DEVICE, lr=self._rate)
        for state in self.optimiser.state.values():
            state["step"] = state["step"].to(self.device, torch.float32)
        self._crop = 0  # a recording writes to the state of before

    def _record(self, rgb: Tensor, coc: Tensor) -> None:
        """Record a step on batches of this size."""
        self._rgb = rgb.contiguous(memory_format=torch.channels_last).clone()
        self._coc = coc.clone()
        self._rate.zero_()
        self._follow.zero_()
        beside = torch.cuda.Stream()
        beside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(beside):
            for _ in range(WARM_UP):
                self._descend()
        torch.cuda.current_stream().wait_stream(beside)
        torch.cuda.synchronize()
        self._graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(self._graph):
            self._shown = self._descend()

    def _descend(self) -> Tensor:
        """A step on the batch in place: loss, gradients, weights and their average."""
        self.optimiser.zero_grad(set_to_none=True)
        with torch.autocast("cuda", dtype=torch.bfloat16, cache_enabled=False):
            answer = self._answer(self._rgb)
        loss, likelihood = laplace_loss(answer, self._coc, self.recipe.beta)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), GRADIENT_NORM)
        self.optimiser.step()
        slow, fast = (list(n.parameters()) for n in (self.average, self.network))
        with torch.no_grad():
            steps = torch._foreach_sub(fast, slow)
            torch._foreach_mul_(steps, self._follow)
            torch._foreach_add_(slow, steps)
        return likelihood.detach()
