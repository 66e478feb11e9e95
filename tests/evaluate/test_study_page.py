import base64
import json
import re
from collections import Counter
from html import unescape
from urllib.parse import unquote

import pytest
from support.browser import chromium
from support.command import nlens, one_line
from support.page_reader import read
from support.study_answers import write_folder

PERSON = """
<script>
addEventListener("load", () => {
  const key = (name) => document.body.dispatchEvent(
    new KeyboardEvent("keydown", { key: name, bubbles: true, cancelable: true }));
  at("participant").value = "PERSON";
  at("begin").requestSubmit();
  const log = [];
  while (at("end").hidden) {
    log.push([document.activeElement.id, at("picture").src.length, at("picture").alt]);
    if (log.length === 1) { key("Enter"); log.push([at("missing").textContent]); }
    key("0"); key("2"); key("1"); key("2");
    if (log.length === 4) key("0");
    key("Enter");
  }
  document.body.dataset.log = JSON.stringify(log);
});
</script>
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    home = tmp_path_factory.mktemp("study")
    stimuli = write_folder(home / "pictures", apertures=3)
    page = home / "out" / "study.html"
    page.parent.mkdir()
    run = nlens("study", "make", home / "pictures", page, "--choices", "red,green,yellow,blue")
    assert run.returncode == 0, run.stderr
    return page, stimuli


def test_study_page_is_said_to_be_written_with_its_number_of_pictures(made, tmp_path):
    page, stimuli = made
    pictures, out = page.parent.parent / "pictures", tmp_path / "study.html"
    said = nlens("study", "make", pictures, out)
    assert said.stderr == f"wrote  {out}, {len(stimuli)} pictures\n" and not said.stdout
    quiet = nlens("study", "-q", "make", pictures, out, "-y")
    assert not quiet.stderr and not quiet.stdout
    as_json = nlens("study", "--json", "make", pictures, out, "-y")
    assert json.loads(as_json.stdout) == {"saved": str(out), "pictures": len(stimuli)}
    assert not as_json.stderr


def test_study_page_is_self_contained_and_well_formed(made):
    path, stimuli = made
    text = path.read_text()
    page = read(text)
    assert page.fetched == []
    assert not re.search(r"https?://", text)
    assert "virtual billiard balls" in page.text and page.all("html") == [{"lang": "en"}]
    boxes = [box for box in page.all("input") if box.get("type") == "checkbox"]
    assert [box["value"] for box in boxes] == ["red", "green", "yellow", "blue", ""]
    labelled = {label.get("for") for label in page.all("label")}
    assert "participant" in labelled and len(page.all("legend")) == 1
    trials = json.loads(re.search(r"^const trials = (.*);$", text, re.M).group(1))
    assert [trial["file"] for trial in trials] == [one.file for one in stimuli]
    picture = base64.b64decode(trials[0]["src"].removeprefix("data:image/png;base64,"))
    assert picture == (path.parents[1] / "pictures" / stimuli[0].file).read_bytes()


def test_text_from_the_study_list_is_escaped(tmp_path):
    stimuli = write_folder(tmp_path / "pictures", positions=1)
    path = tmp_path / "pictures" / "stimuli.csv"
    path.write_text(path.read_text().replace("naive", "</script><b>x"))
    page = tmp_path / "a.html"
    assert nlens("study", "make", path.parent, page, "--things", "<i>$$ &").returncode == 0
    assert read(page.read_text()).all("b") == [] and read(page.read_text()).all("i") == []
    assert len(stimuli) == 3


def take_part(page, person):
    """What a person who works by keyboard saves, in a real browser."""
    with_person = page.with_name(f"{person}.html")
    script = PERSON.replace("PERSON", person)
    with_person.write_text(page.read_text().replace("</body>", script + "</body>"))
    dumped = chromium(page.parent, "--dump-dom", with_person.as_uri())
    log = json.loads(unescape(re.search(r'data-log="([^"]*)"', dumped).group(1)))
    kept = {}
    for ending in ("json", "csv"):
        link = re.search(rf'<a id="{ending}"[^>]*>', dumped).group(0)
        assert f'download="answers-{person}.{ending}"' in link
        address = re.search(r'href="data:[^,]*,([^"]*)"', link).group(1)
        kept[ending] = page.parent / f"{person}.{ending}"
        kept[ending].write_text(unquote(unescape(address)))
    return kept, log


@pytest.mark.slow
@pytest.mark.needs_chromium
def test_keyboard_user_sees_every_picture_once_in_a_random_order(made):
    page, stimuli = made
    first, log = take_part(page, "p-1")
    answers = json.loads(first["json"].read_text())["answers"]
    assert sorted(a["file"] for a in answers) == sorted(one.file for one in stimuli)
    assert [a["order"] for a in answers] == list(range(1, len(stimuli) + 1))
    assert [a["file"] for a in answers] != [one.file for one in stimuli]
    assert log[1] == ["Choose at least one answer, or No."]
    pictures = [entry for entry in log if len(entry) == 3]
    assert {entry[0] for entry in pictures} == {"progress"}  # the focus is led to each new picture
    assert all(entry[1] > 50 and entry[2] for entry in pictures)
    chosen = Counter(tuple(a["chosen"]) for a in answers)
    assert chosen == {("red",): len(stimuli) - 1, (): 1}  # red stays, and "No" takes it back once
    again, _ = take_part(page, "p-1")
    order = [a["file"] for a in answers]
    assert [a["file"] for a in json.loads(again["json"].read_text())["answers"]] == order
    other, _ = take_part(page, "p-2")
    assert [a["file"] for a in json.loads(other["json"].read_text())["answers"]] != order
    run = nlens("study", "analyse", first["json"], other["csv"], "--json")
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert found["participants"] == 2
    assert sum(one["trials"] for one in found["methods"]) == 2 * len(stimuli)


def test_folder_without_a_study_list_is_refused_in_one_line(tmp_path):
    assert "stimuli.csv" in one_line(nlens("study", "make", tmp_path, tmp_path / "a.html"), 3)


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [("file,position", "name,position", "file"), ("000.png", "gone.png", "gone.png"),
     ("naive", "", "method"), ("000.png", "stimuli.csv", "expected one of"),
     ("000.png", "001.png", "twice")],
)  # fmt: skip
def test_invalid_study_list_is_refused_in_one_line(tmp_path, before, after, told):
    write_folder(tmp_path / "pictures")
    path = tmp_path / "pictures" / "stimuli.csv"
    path.write_text(path.read_text().replace(before, after, 1))
    words = ["study", "make", path.parent, tmp_path / "a.html"]
    assert told in one_line(nlens(*words), 3) and not (tmp_path / "a.html").exists()


@pytest.mark.parametrize("choices", ["red,green", "red,green,yellow,", "red,red,green,yellow"])
def test_choices_without_a_correct_answer_are_refused_in_one_line(tmp_path, choices):
    write_folder(tmp_path / "pictures")
    words = ["study", "make", tmp_path / "pictures", tmp_path / "a.html", "--choices", choices]
    assert "yellow" in one_line(nlens(*words), 2)


def test_invalid_arguments_are_refused_in_one_line():
    one_line(nlens("study"), 2)
    one_line(nlens("study", "make", "a"), 2)
