"""`samples/truth/rendered_walkers.py`: people go where their routes say, and the truth shows it."""

import json

import cv2
import numpy as np
import pytest
from support.folders import SAMPLES

SEEDS = {"before": 8608, "behind": 8617, "both": 8611}


@pytest.fixture(autouse=True)
def _samples_on_the_path(monkeypatch):
    monkeypatch.syspath_prepend(str(SAMPLES))


def routes_of(kind, frames=30):
    from truth.plan import draw_view
    from truth.routes import routes

    view = draw_view(SEEDS[kind])
    return view, routes(view, frames)


@pytest.mark.parametrize("kind", SEEDS)
def test_people_begin_and_end_beside_the_object(kind):
    from truth import subject

    view, people = routes_of(kind)
    low, high = (pick(subject.mesh(view).positions[:, 0]) for pick in (np.min, np.max))
    assert len(people) == (2 if kind == "both" else 1)
    for person in people:
        for moment in (-0.5, person.frames - 0.5):
            x, _ = person.at(moment)
            assert not low < x < high


@pytest.mark.parametrize("kind", SEEDS)
def test_people_walk_and_do_not_run(kind):
    for person in routes_of(kind, frames=30)[1]:
        ways = np.diff([person.at(frame) for frame in range(30)], axis=0)
        assert np.linalg.norm(ways, axis=1).max() < 0.2 * person.height_m


@pytest.mark.parametrize(
    ("kind", "nearer"),
    [("before", {True}), ("behind", {False}), ("both", {False, True})],
)
def test_people_pass_the_object_on_the_sides_that_the_kind_names(kind, nearer):
    from truth import subject

    view, people = routes_of(kind)
    low, high = (pick(subject.mesh(view).positions[:, :2], axis=0) for pick in (np.min, np.max))
    passed = set()
    for person in people:
        for frame in np.arange(0, person.frames, 0.25):
            x, y = person.at(frame)
            assert not (low[0] < x < high[0] and low[1] < y < high[1])
            if low[0] < x < high[0]:
                passed.add(bool(y < low[1]))
    assert passed == nearer


def test_nobody_walks_where_his_feet_would_leave_the_frame():
    from truth.plan import HEIGHT, draw_view
    from truth.routes import routes

    refused = 0
    for seed in range(8600, 8640):
        view = draw_view(seed)
        try:
            near = routes(view, 30)[0].near
        except ValueError as error:
            assert str(seed) in str(error)
            refused += 1
            continue
        assert view.project(np.array([[view.place[0], near, 0.0]]))[0, 1] < HEIGHT
    assert 0 < refused < 40


@pytest.mark.slow
@pytest.mark.needs_blender
def test_rendered_clip_hides_the_object_where_somebody_walks_before_it(tmp_path, monkeypatch):
    from truth import rendered_walkers
    from truth.clip_file import read_clip_file

    monkeypatch.setattr(
        "sys.argv",
        ["x", "--seed", str(SEEDS["before"]), "--out", str(tmp_path), "--frames", "5",
         "--samples", "8", "--percent", "25"],
    )  # fmt: skip
    rendered_walkers.main()
    folder = tmp_path / f"{SEEDS['before']}_before"
    told = json.loads((folder / "params.json").read_text())
    shares = told["hidden_share"]
    assert len(shares) == 5 and max(shares[0], shares[4]) == 0.0 < 0.1 < max(shares)
    left, top, right, bottom = told["box"]
    frames = list(read_clip_file(folder / "bg.mp4"))
    apart = []
    for frame, plate in enumerate(frames):
        truth = cv2.imread(str(folder / f"gt/{frame:04d}.png"))[..., ::-1]
        off = np.abs(truth - 255.0 * plate)[top:bottom, left:right].max(2)
        apart.append(float((off > 24).mean()))
    shown = apart[0]
    assert shown > 0.02
    assert apart[int(np.argmax(shares))] < shown * (1.2 - max(shares))
