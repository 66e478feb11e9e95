import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm
from support.study_answers import answer

from nlens_video.cli.main import main
from nlens_video.evaluate.study.analysis import two_proportion_test


def saved(path, participant, counts):
    """A file of answers: method to (failures, trials)."""
    rows = [
        answer(participant, 0, method, failed=at < failures)
        for method, (failures, trials) in counts.items()
        for at in range(trials)
    ]
    rows = [row | {"order": n + 1, "file": f"{n:03d}.png"} for n, row in enumerate(rows)]
    if path.suffix == ".json":
        path.write_text(json.dumps({"participant": participant, "answers": rows}))
    else:
        lines = [",".join(rows[0])]
        for row in rows:
            cells = [";".join(v) if isinstance(v, list) else str(v) for v in row.values()]
            lines.append(",".join(f'"{cell}"' for cell in cells))
        path.write_text("\n".join(lines) + "\n")
    return path


def by_hand(one, other):
    pooled = (one[0] + other[0]) / (one[1] + other[1])
    error = math.sqrt(pooled * (1 - pooled) * (1 / one[1] + 1 / other[1]))
    z = (one[0] / one[1] - other[0] / other[1]) / error
    return z, 2 * norm.sf(abs(z))


@given(
    st.tuples(st.integers(0, 60), st.integers(1, 60)),
    st.tuples(st.integers(0, 60), st.integers(1, 60)),
)
def test_two_proportion_test_agrees_with_a_textbook_example(one, other):
    one, other = ((failures, failures + rest) for failures, rest in (one, other))
    z, p = two_proportion_test(one, other)
    if one[0] + other[0] == 0:
        assert math.isnan(z) and math.isnan(p)
        return
    expected = by_hand(one, other)
    assert z == pytest.approx(expected[0], abs=1e-9) and p == pytest.approx(expected[1])


def test_two_proportion_test_reproduces_the_papers_significance():
    # 25 people, 27 pictures of each method; 90 % against 74.9 and 75.1 %
    for rate in (0.749, 0.751):
        z, p = two_proportion_test((608, 675), (round(rate * 675), 675))
        assert z > 7 and 1e-16 < p < 1e-11


def test_answers_of_several_participants_make_one_table(tmp_path, capsys):
    files = [
        saved(tmp_path / "a.json", "a", {"naive": (3, 10), "ours": (9, 10)}),
        saved(tmp_path / "b.csv", "b", {"naive": (4, 10), "ours": (10, 10)}),
    ]
    assert main(["study", "analyse", *map(str, files), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["participants"], found["reference"]) == (2, "ours")
    naive, ours = found["methods"]
    assert (naive["failures"], naive["trials"], naive["rate"]) == (7, 20, 0.35)
    assert (ours["failures"], ours["trials"], ours["z"], ours["p"]) == (19, 20, None, None)
    z, p = by_hand((19, 20), (7, 20))
    assert naive["z"] == pytest.approx(z) and naive["p"] == pytest.approx(p)
    assert naive["low"] < 0.35 < naive["high"] < ours["low"]
    assert main(["study", "analyse", *map(str, files)]) == 0
    table = capsys.readouterr().out
    assert "# Answers of 2 participants" in table and "95.0%" in table and "nan" not in table


def test_missing_answer_counts_as_a_failure_to_find_the_object(tmp_path, capsys):
    path = tmp_path / "a.json"
    row = answer("a", 0, "ours", failed=True) | {"chosen": []}
    path.write_text(json.dumps({"answers": [row]}))
    assert main(["study", "analyse", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["methods"][0]["failures"] == 1


def one_line(capsys, words, code):
    assert main([str(word) for word in words]) == code
    told = capsys.readouterr()
    assert told.out == "" and told.err.startswith("nlens-video: ") and told.err.count("\n") == 1
    return told.err


def test_duplicate_participant_is_refused_in_one_line(tmp_path, capsys):
    files = [saved(tmp_path / f"{n}.json", "a", {"ours": (1, 2)}) for n in range(2)]
    assert "twice" in one_line(capsys, ["study", "analyse", *files], 3)


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", '{"answers": [{}]}', '{"answers": [{"chosen": "red"}]}', "\x00"]
)
@pytest.mark.parametrize("name", ["a.json", "a.csv"])
def test_invalid_answer_file_is_refused_in_one_line(tmp_path, capsys, name, text):
    (tmp_path / name).write_text(text)
    assert name in one_line(capsys, ["study", "analyse", tmp_path / name], 3)


def test_method_without_answers_is_refused_in_one_line(tmp_path, capsys):
    path = saved(tmp_path / "a.json", "a", {"naive": (1, 2)})
    assert "naive" in one_line(capsys, ["study", "analyse", path], 2)
