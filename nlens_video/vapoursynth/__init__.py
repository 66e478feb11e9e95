"""The filter for VapourSynth: `nlens_video.vapoursynth.composite(clip, "anim.glb", **options)`."""

from nlens_video.adapters.vapoursynth_clip import composite

__all__ = ["composite"]
