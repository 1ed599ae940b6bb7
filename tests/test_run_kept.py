"""The results of earlier runs of `lazyloc run` stay, whatever interrupts it."""

import contextlib
import itertools
import json
import pathlib
import re
import shutil

import pytest

import photo_scene
from colmap_lazyloc.__main__ import main
from colmap_lazyloc.project import steps
from colmap_lazyloc.project.folder import Folder
from colmap_lazyloc.project.kept import KeptResults
from colmap_lazyloc.report.page import set_links, single_page
from colmap_lazyloc.results import find_run, read_results

KEYS = ("first", "second", "third")


class Interrupted(BaseException):
    """Ends a run at once."""


def work(folder, key, inputs="", is_killed=False):
    """Does what a run does that needs the results of a key; returns whether it computed."""
    kept = KeptResults(folder)
    if not kept.begin(key, inputs, f"photos of {key}", "lazyloc run"):
        return False
    records = folder.localized / "unfinished" / "records.bin"
    records.parent.mkdir(parents=True, exist_ok=True)
    records.write_text(key)
    if is_killed:
        raise Interrupted
    (folder.localized / "results.jsonl").write_text(key)
    shutil.rmtree(folder.localized / "unfinished")
    kept.finish()
    folder.report.write_text("".join(single_page(key, {}, [])))
    kept.link()
    return True


def found(folder):
    """Returns the keys of results by the folder that has them; checks that no files are mixed."""
    keys = {}
    for place in (folder.path, *sorted((folder.path / "earlier").glob("*"))):
        results = place / "localized" / "results.jsonl"
        if results.exists():
            key = results.read_text()
            keys[place.name] = key
            assert json.loads((place / "run.json").read_text())["key"] == key
            page = place / "report.html"
            assert not page.exists() or f"<title>{key}</title>" in page.read_text()
        else:
            assert not (place / "report.html").exists()
    return keys


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "out").mkdir()
    return Folder(tmp_path / "out")


def test_newest_results_are_at_the_top(folder):
    assert [work(folder, key) for key in KEYS] == [True] * 3
    assert found(folder) == {"out": "third", "1": "first", "2": "second"}
    assert not work(folder, "third")
    assert not work(folder, "first"), "they are back, and nothing is computed"
    assert found(folder) == {"out": "first", "2": "second", "3": "third"}


def test_pages_lead_to_each_other(folder):
    for key in KEYS:
        work(folder, key)
    newest, earlier = (path.read_text() for path in (folder.report, folder.path / "earlier" / "1" / "report.html"))
    links = re.findall('<a href="([^"]+)">([^<]+)</a>', newest)
    assert links == [("earlier/2/report.html", "photos of second"), ("earlier/1/report.html", "photos of first")]
    assert re.findall('<a href="([^"]+)">', earlier) == ["../../report.html"]


def test_links_are_replaced_and_the_page_stays(tmp_path):
    page = tmp_path / "page.html"
    page.write_text(before := "".join(single_page("title", {"summary": b"{}"}, [b"photo"])))
    for links in ("one", "two & \udcff", ""):
        set_links(page, links)
    assert page.read_text() == before


def test_interrupted_run_goes_on_and_is_kept_for_another(folder):
    for key, inputs, expected in (("first", "same", True), ("first", "same", True), ("second", "", True)):
        with pytest.raises(Interrupted):
            work(folder, key, inputs, is_killed=True)
        assert (folder.localized / "unfinished" / "records.bin").exists() is expected
    assert (folder.path / "earlier" / "1" / "localized" / "unfinished" / "records.bin").read_text() == "first"
    kept = KeptResults(folder)
    assert kept.begin("first", "same", "", "") and (folder.localized / "unfinished" / "records.bin").exists()
    assert kept.begin("first", "other", "", "") and not folder.localized.exists(), "of another database: from scratch"


def test_nothing_is_kept_of_a_run_that_has_computed_nothing(folder):
    assert KeptResults(folder).begin("first", "", "", "")
    folder.localized.mkdir()
    assert work(folder, "second")
    assert found(folder) == {"out": "second"}
    assert not (folder.path / "earlier").exists()


def test_own_files_in_a_folder_of_earlier_results_stay(folder):
    for key in KEYS[:2]:
        work(folder, key)
    (folder.path / "earlier" / "1" / "mine.txt").write_text("mine")
    work(folder, "first")
    assert (folder.path / "earlier" / "1" / "mine.txt").read_text() == "mine"
    assert found(folder) == {"out": "first", "2": "second"}


def test_results_of_an_older_version_are_kept(folder):
    (folder.localized).mkdir()
    (folder.localized / "results.jsonl").write_text("old")
    work(folder, "first")
    assert (folder.path / "earlier" / "1" / "localized" / "results.jsonl").read_text() == "old"


def interrupt(patch, moment, has_effect):
    """Ends the run at a change on the disk, which is made if it `has_effect`, as all before are, and none after it."""
    count = 0

    def limited(operation):
        def change(*values, **options):
            nonlocal count
            count += 1
            done = operation(*values, **options) if count < moment or (has_effect and count == moment) else None
            if count >= moment:
                raise Interrupted
            return done

        return change

    for name in ("replace", "rename", "symlink_to", "unlink", "rmdir", "mkdir", "write_text"):
        patch.setattr(pathlib.Path, name, limited(getattr(pathlib.Path, name)))


@pytest.mark.parametrize("has_effect", [False, True])
@pytest.mark.parametrize("wanted", ["first", "fourth"])
def test_killed_at_any_moment_nothing_is_lost_or_mixed(wanted, has_effect, tmp_path, monkeypatch):
    base = Folder(tmp_path / "base")
    base.path.mkdir()
    for key in KEYS:
        work(base, key)
    for moment in itertools.count(1):
        folder = Folder(tmp_path / str(moment) / "out")
        shutil.copytree(base.path, folder.path)
        with monkeypatch.context() as patch, contextlib.suppress(Interrupted):
            interrupt(patch, moment, has_effect)
            work(folder, wanted)
            break
        KeptResults(folder)
        held = list(found(folder).values())
        assert set(held) >= set(KEYS) and len(held) == len(set(held)), moment
        work(folder, wanted)
        assert found(folder)["out"] == wanted
        assert sorted(found(folder).values()) == sorted({*KEYS, wanted})
    assert moment > 10


@pytest.fixture
def run(colmap, photos, monkeypatch, tmp_path):
    """Returns a function that runs `lazyloc run` with a photo as query; returns the output folder."""
    monkeypatch.setenv("COLMAP", str(colmap))

    def start(query, *more):
        words = ["run", "--database_images", photos.image_path / "database", "--poses", photos.model_path]
        words += ["--queries", photos.image_path / "query" / query, "--output", tmp_path / "out", *photo_scene.SIFT]
        assert main([str(word) for word in [*words, *more]]) == 0
        return Folder(tmp_path / "out")

    return start


def files(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_other_queries_and_options_leave_earlier_results(run, photos, tmp_path, capsys):
    folder = run("0.png")
    first = files(folder.localized)
    run("1.png")
    assert f"now in {folder.path}/earlier/1: the results of --queries {photos.image_path}/query/0.png" in (
        capsys.readouterr().err
    )
    assert files(folder.path / "earlier" / "1" / "localized") == first
    assert list(read_results(find_run(folder.path).results / "results.jsonl")) == ["query/1.png"]
    assert 'href="earlier/1/report.html"' in folder.report.read_text()
    page = folder.report.read_bytes()
    assert main(["report", str(folder.path)]) == 0
    assert folder.report.read_bytes() == page, "with the photos and the links"
    assert main(["report", str(folder.path / "earlier" / "1")]) == 1, "its photos are others by now"
    assert "required: --output" in capsys.readouterr().err
    run("1.png", "--LazyLocalizer.seed", "3")
    assert sorted(path.name for path in (folder.path / "earlier").iterdir()) == ["1", "2"]
    capsys.readouterr()
    run("0.png")
    printed = capsys.readouterr()
    assert (
        "localizing" not in printed.err and "1 of 1 queries localized" in printed.out and "query/0.png" in printed.out
    )
    assert files(folder.localized) == first
    assert "replaces the results" not in folder.log.read_text()
    assert (
        main(["export", str(folder.path / "earlier" / "2"), "--format", "poses", "--output", str(tmp_path / "p")]) == 1
    )
    words = ["--format", "tum", "--output", str(tmp_path / "poses.tum")]
    for place in (folder.path, folder.localized, folder.path / "earlier" / "3"):
        assert main(["export", str(place), *words, "--overwrite"]) == 0
        assert main(["report", str(place), "--output", str(tmp_path / "page.html")]) == 0
        assert main(["evaluate", str(place), "--ground_truth", str(place), "--unit", "m"]) == 0
        assert find_run(place).project.model.resolve() == folder.model.resolve()
    run("0.png", "--overwrite")
    assert not (folder.path / "earlier").exists() and folder.report.exists()


def test_a_run_that_fails_leaves_earlier_results(run, photos, monkeypatch, capsys):
    folder = run("0.png")
    first = files(folder.localized)
    monkeypatch.setattr(steps.ColmapRunner, "run", lambda *words: (_ for _ in ()).throw(Interrupted))
    with pytest.raises(Interrupted):
        run("1.png")
    assert files(folder.path / "earlier" / "1" / "localized") == first
    assert main(["export", str(folder.path), "--format", "tum", "--output", str(folder.path / "p.tum")]) == 1
    assert "the last run has no results yet" in capsys.readouterr().err


@pytest.mark.parametrize("size", [-100, 0])
def test_damaged_index_is_made_again(run, monkeypatch, size, capsys):
    monkeypatch.setattr(steps, "MAX_NUM_EXHAUSTIVE", 3)  # of 6 database images
    folder = run("0.png")
    intact = folder.index.read_bytes()
    folder.index.write_bytes(intact[:size] if size else b"\0" + intact[1:])
    run("1.png")
    printed = capsys.readouterr()
    assert "database.index: is damaged and is made again" in printed.err and "1 of 1 queries localized" in printed.out
    assert folder.index.read_bytes() == intact
    run("0.png", "--LazyLocalizer.seed", "0")
    assert "is damaged" not in capsys.readouterr().err
