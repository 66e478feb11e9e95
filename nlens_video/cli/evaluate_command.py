"""The command `evaluate`: which of the evaluations runs."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from nlens_video.cameras.solved import SolvedCamera
from nlens_video.cli.solve_command import solve_camera
from nlens_video.core.settings import SourceSettings
from nlens_video.solve.shot import Cue


def run_evaluate(args: Namespace) -> int:
    """The command `evaluate`."""
    if args.what == "camera":
        return _cameras(args)
    if args.what == "composite":
        from nlens_video.evaluate.composite.composite import evaluate_composite as evaluate
    elif args.what == "scene":
        from nlens_video.evaluate.composite.scene import evaluate_scene as evaluate
    elif args.what == "sequences":
        from nlens_video.evaluate.composite.sequences import evaluate_sequences as evaluate
    elif args.what == "occlusion":
        from nlens_video.evaluate.composite.occlusion import evaluate_occlusion as evaluate
    else:
        from nlens_video.evaluate.coc.protocol import evaluate_coc as evaluate
    evaluate(args.folder, args.out, as_json=args.json, quiet=args.quiet)
    return 0


def _cameras(args: Namespace) -> int:
    from nlens_video.evaluate.camera.protocol import evaluate_camera

    with TemporaryDirectory(prefix="nlens-video-camera-") as folder:
        output = Path(folder) / "camera.json"

        def solve(plate: Path, cues: Sequence[Cue]) -> SolvedCamera:
            return solve_camera(SourceSettings(spec=str(plate)), output, cues=cues)

        evaluate_camera(args.folder, args.out, solve, as_json=args.json, quiet=args.quiet)
    return 0
