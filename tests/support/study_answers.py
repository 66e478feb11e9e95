"""Stimuli and answers made by a test: `from support.study_answers import write_folder`."""

import cv2
import numpy as np

from nlens_video.evaluate.study.page import Stimulus, write_stimuli

METHODS = ("naive", "blind", "ours")
COLOURS = ("red", "green", "yellow")


def write_folder(folder, positions=3, apertures=1, focuses=1):
    """Small pictures of a colour each, in all combinations, and their list."""
    folder.mkdir(parents=True)
    stimuli = []
    for number in range(positions * apertures * focuses * len(METHODS)):
        rest, method = divmod(number, len(METHODS))
        rest, position = divmod(rest, positions)
        focus, aperture = divmod(rest, apertures)
        name = f"{number:03d}.png"
        picture = np.full((12, 16, 3), 20 + 2 * number, np.uint8)
        assert cv2.imwrite(str(folder / name), picture)
        stimuli.append(
            Stimulus(
                file=name, position=str(position), aperture=f"f/{aperture + 1}",
                focus=str(focus), method=METHODS[method], virtual=COLOURS[position % 3],
            )
        )  # fmt: skip
    write_stimuli(folder, stimuli)
    return stimuli


def answer(participant, number, method, *, failed):
    """One row as the page saves it."""
    return {
        "participant": participant, "order": number + 1, "file": f"{number:03d}.png",
        "position": "1", "aperture": "2", "focus": "3", "method": method, "virtual": "red",
        "chosen": ["green"] if failed else ["green", "red"], "seconds": 1.5,
    }  # fmt: skip
