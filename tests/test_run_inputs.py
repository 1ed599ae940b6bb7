"""What `lazyloc run` does with photos, names, folders and options that are unusual or wrong."""

import os
import shutil
import sqlite3
import struct
import tracemalloc

import cv2
import numpy as np
import PIL.Image
import pytest

import photo_scene
from benchmarks.photos.oriented_photos import write_oriented
from colmap_lazyloc.__main__ import main
from colmap_lazyloc.database import tidy_images
from colmap_lazyloc.errors import InputError
from colmap_lazyloc.pose_formats.posed_images import ORIENTATION, decode_as_stored, photo_size
from colmap_lazyloc.poses import read_poses
from colmap_lazyloc.project import photos as photos_of_projects
from colmap_lazyloc.project.folder import DATABASE, QUERY, RECORD, Folder, Steps, content, fingerprint
from colmap_lazyloc.project.photos import convert_photos, find_photos, has_one_camera, link_photos, safe_names
from colmap_lazyloc.report import __main__ as report
from colmap_lazyloc.results import read_results
from colmap_lazyloc.testing import synthetic
from exif import write_jpeg

CAMERA = photo_scene.CAMERA
EXIF_MAKE = 271
NOT_UTF8 = os.fsdecode(b"caf\xe9.png")


def test_fingerprint_of_a_large_model_takes_little_memory(tmp_path):
    with (tmp_path / "points3D.bin").open("wb") as file:
        file.truncate(1 << 27)
    tracemalloc.start()
    content(tmp_path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 23


@pytest.fixture
def place(photos, tmp_path):
    """Copies the photos into folders that a test may change."""
    folder = tmp_path / "place"
    for name in (DATABASE, QUERY):
        shutil.copytree(photos.image_path / name, folder / name)
    return folder


@pytest.fixture
def run(colmap, photos, place, monkeypatch, tmp_path):
    """Returns a function that runs `lazyloc run` without the page of the report and returns the output folder."""

    def write_report(words):
        with open(words[words.index("--output") + 1], "w") as page:
            page.write("report")
        return 0

    monkeypatch.setenv("COLMAP", str(colmap))
    monkeypatch.setattr(report, "main", write_report)

    def start(*more, queries=None, output=None, exit_code=0):
        output = output or tmp_path / "out"
        words = ["run", "--database_images", place / DATABASE, "--poses", photos.model_path, "--output", output]
        words += ["--queries", queries or place / QUERY, *photo_scene.SIFT, *more]
        assert main([str(word) for word in words]) == exit_code
        return output

    return start


def localized(output):
    return sorted(read_poses(output / "localized" / "poses.txt"))


def warnings(capsys):
    return [line for line in capsys.readouterr().err.splitlines() if "left out" in line]


def test_bad_photos_are_left_out_by_name(run, place, capsys):
    """Database images that are empty, unreadable, of another size, links to themselves; unreadable queries."""
    (place / DATABASE / "0.png").write_bytes(b"")
    (place / DATABASE / "1.png").unlink()
    (place / DATABASE / "1.png").symlink_to("1.png")
    small = cv2.resize(cv2.imread(str(place / DATABASE / "2.png")), None, fx=0.5, fy=0.5)
    cv2.imwrite(str(place / DATABASE / "2.png"), small)
    (place / QUERY / "bad.png").write_bytes(b"no photo")
    (place / QUERY / "lost.png").symlink_to("nowhere.png")
    (place / QUERY / "loop.png").symlink_to("loop.png")
    output = run()
    (line,) = warnings(capsys)
    assert "3 of 6 photos are left out: database/0.png (cannot be read), database/1.png (cannot be read)" in line
    assert "database/2.png (has 240 x 180 pixels, its camera 480 x 360)" in line
    assert localized(output) == ["query/0.png", "query/1.png"]
    results = read_results(output / "localized" / "results.jsonl")
    assert {results[f"query/{name}.png"]["status"] for name in ("bad", "lost", "loop")} == {"UNREADABLE_IMAGE"}
    run("--strict", exit_code=2)  # the names come again
    assert len(warnings(capsys)) == 1


def test_nothing_left_is_one_line(run, place, capsys):
    for path in (place / DATABASE).iterdir():
        path.write_bytes(b"no photo")
    run(exit_code=1)
    (line,) = warnings(capsys)
    assert "6 of 6 photos are left out: database/0.png (cannot be read)" in line and "and 1 others" in line


@pytest.mark.parametrize(("option", "role"), [("--camera", DATABASE), ("--query_camera", QUERY)])
@pytest.mark.parametrize("orientation", [None, 6])
def test_camera_of_another_size_is_one_line_before_any_work(run, place, tmp_path, option, role, orientation, capsys):
    """A photo that viewers turn upright has another size there than in its file, which is the one that counts."""
    size = "1280 x 720"
    if orientation is not None:
        size = "480 x 360"
        for path in list((place / role).iterdir()):
            write_oriented(path.with_suffix(".jpg"), path, orientation)
            path.with_suffix(".jpg").rename(path)
    run(option, f"PINHOLE {size.replace(' x', '')} 400 400 240 180", exit_code=1)
    stored = "480 x 360" if orientation is None else "360 x 480"
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"lazyloc run: {option} is for {size} pixels, but photo {role}/0.png is stored with {stored}"
    assert not (tmp_path / "out" / "database.db").exists()


def test_query_of_another_size_than_the_others_gets_a_reason(run, place):
    cv2.imwrite(str(place / QUERY / "0.png"), np.zeros((720, 1280, 3), np.uint8))
    output = run("--query_camera", CAMERA.text())
    assert localized(output) == ["query/1.png"]
    assert "1280 x 720" in read_results(output / "localized" / "results.jsonl")["query/0.png"]["reason"]


def test_bad_queries_and_masks_of_a_sequence(run, place, capsys):
    for name in ("0", "1"):
        path = place / "masks" / QUERY / f"{name}.png.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"no mask" if name == "0" else (place / QUERY / "1.png").read_bytes())
    (place / QUERY / "2.png").write_bytes(b"no photo")
    (place / QUERY / "3.png").write_bytes((place / QUERY / "0.png").read_bytes())
    output = run("--masks", place / "masks", "--sequence", "2")
    (line,) = warnings(capsys)
    assert "1 of 4 photos are left out: query/0.png (its mask cannot be read)" in line
    results = read_results(output / "localized" / "results.jsonl")
    assert sorted(results) == ["query/1.png", "query/2.png", "query/3.png"]
    assert results["query/2.png"]["status"] == "UNREADABLE_IMAGE" and results["query/3.png"]["status"] == "LOCALIZED"


@pytest.mark.parametrize("name", [NOT_UTF8, "a\nb.png", "tab\tand \x01.png", r"back\slash.png", "d\udcff/ü 1.png"])
def test_unusual_names_are_used(run, place, name, capsys):
    for role, source in ((DATABASE, "2.png"), (QUERY, "1.png")):
        path = place / role / name
        path.parent.mkdir(exist_ok=True)
        (place / role / source).rename(path)
    output = run("--sequence", "2")
    safe = safe_names([name])[name]
    assert localized(output) == sorted(["query/0.png", f"query/{safe}"])
    printed = capsys.readouterr()
    assert f"query/{safe}" in printed.out and "1 of 6 photos have no pose" in printed.err


def test_safe_names_are_different_ones():
    assert safe_names(["a b.jpg", "a_b.jpg", "a\tb.jpg", "a c/d.jpg"]) == {
        "a_b.jpg": "a_b.jpg",
        "a\tb.jpg": "a_b_.jpg",
        "a b.jpg": "a_b__.jpg",
        "a c/d.jpg": "a_c/d.jpg",
    }


def test_kinds_of_photos_that_colmap_reads(run, place, photos, tmp_path):
    shutil.copytree(photos.model_path, tmp_path / "poses")
    poses = tmp_path / "poses" / "images.txt"
    for source, suffix, form in (
        ("0.png", "webp", "WEBP"),
        ("1.png", "jfif", "JPEG"),
        ("2.png", "jp2", "JPEG2000"),
        ("3.png", "GIF", "GIF"),
        ("4.png", "tga", "TGA"),
    ):
        path = place / DATABASE / source
        PIL.Image.open(path).save(path.with_suffix(f".{suffix}"), form, quality=95)
        path.unlink()
        poses.write_text(poses.read_text().replace(source, f"{source[0]}.{suffix}"))
    PIL.Image.open(place / QUERY / "0.png").save(place / QUERY / "0.JPE", "JPEG", quality=95)
    (place / QUERY / "0.png").unlink()
    output = run("--poses", tmp_path / "poses")
    assert localized(output) == ["query/0.JPE", "query/1.png"]
    with sqlite3.connect(output / "database.db") as database:
        assert database.execute("SELECT COUNT(*) FROM keypoints WHERE rows > 100").fetchone() == (6,)


def test_photos_of_phones_are_converted_once(run, place, photos, tmp_path, capsys):
    pytest.importorskip("pillow_heif").register_heif_opener()
    poses = shutil.copytree(photos.model_path, tmp_path / "poses") / "images.txt"
    exif = PIL.Image.Exif()
    exif[EXIF_MAKE] = "Someone"
    for role, source, suffix in ((DATABASE, "0", "HEIC"), (DATABASE, "1", "avif"), (QUERY, "0", "heic")):
        path = place / role / f"{source}.png"
        PIL.Image.open(path).convert("RGB").save(path.with_suffix(f".{suffix}"), quality=90, exif=exif)
        path.unlink()
        if role == DATABASE:
            poses.write_text(poses.read_text().replace(path.name, f"{source}.{suffix}"))
    output = run("--poses", tmp_path / "poses")
    assert localized(output) == ["query/0.heic", "query/1.png"]
    assert "converting 2 photos" in (err := capsys.readouterr().err) and "converting 1 photos" in err
    with PIL.Image.open(output / "images" / "query" / "0.heic") as converted:
        assert converted.format == "JPEG" and converted.getexif()[EXIF_MAKE] == "Someone"
    with sqlite3.connect(output / "database.db") as database:
        assert database.execute("SELECT COUNT(*) FROM keypoints WHERE rows > 100").fetchone() == (6,)
    run("--poses", tmp_path / "poses")
    assert "converting" not in (err := capsys.readouterr().err) and "localizing" not in err


def test_photos_that_colmap_misreads_are_converted(run, place, photos, capsys):
    """Colours of 16 bits, mirror images, and a photo of a phone with the ending of another format."""
    pytest.importorskip("pillow_heif").register_heif_opener()
    for role, source in ((DATABASE, "0.png"), (QUERY, "0.png")):
        path = place / role / source
        cv2.imwrite(str(path), cv2.imread(str(path)).astype(np.uint16) * 257)
    for role in (DATABASE, QUERY):
        path = place / role / "1.png"
        write_oriented(path.with_suffix(".jpg"), path, 5)
        path.with_suffix(".jpg").rename(path)
    path = place / DATABASE / "2.png"
    PIL.Image.open(path).convert("RGB").save(path, "HEIF", quality=90)
    output = run()
    assert localized(output) == ["query/0.png", "query/1.png"]
    assert read_poses(output / "localized" / "poses.txt")["query/1.png"].errors(photos.poses["query/1.png"])[0] < 0.05
    with sqlite3.connect(output / "database.db") as database:
        assert database.execute("SELECT COUNT(*) FROM keypoints WHERE rows > 100").fetchone() == (6,)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_tiff_photos_are_as_they_are_stored(tmp_path, orientation):
    """OpenCV and Pillow turn them upright. Of converted photos, only mirror images are turned."""
    rng = np.random.default_rng(0)
    stored = cv2.resize(rng.integers(0, 255, (4, 6, 3), np.uint8), (60, 40), interpolation=cv2.INTER_NEAREST)
    exif = PIL.Image.Exif()
    exif[ORIENTATION] = orientation
    paths = {"8.tif": tmp_path / "8.tif", "16.tif": tmp_path / "16.tif"}
    PIL.Image.fromarray(stored).save(paths["8.tif"], exif=exif)
    data = np.fromfile(paths["8.tif"], np.uint8)
    for flags in (cv2.IMREAD_COLOR, cv2.IMREAD_REDUCED_COLOR_2):
        assert np.array_equal(decode_as_stored(data, flags), stored[:, :, ::-1])
    assert decode_as_stored(data, cv2.IMREAD_REDUCED_GRAYSCALE_2).shape == (40, 60)
    assert decode_as_stored(data[:40], cv2.IMREAD_COLOR) is None
    write_tiff_of_16_bits(paths["16.tif"], stored, orientation)
    assert photo_size(paths["16.tif"]) == (60, 40)
    with PIL.Image.open(convert_photos(Folder(tmp_path / "out"), QUERY, paths)["16.tif"]) as photo:
        assert photo.format == "JPEG"
        assert photo.getexif().get(ORIENTATION) == (orientation if orientation in (3, 6, 8) else None)
        with PIL.Image.open(paths["8.tif"]) as upright:
            expected = np.asarray(upright.convert("RGB") if orientation in (2, 4, 5, 7) else stored, int)
        assert np.abs(np.asarray(photo, int) - expected).mean() < 12 and photo.size == expected.shape[1::-1]


def write_tiff_of_16_bits(path, pixels, orientation):
    """Writes 16 bits per colour, which Pillow cannot write."""
    assert cv2.imwrite(str(path), pixels[:, :, ::-1].astype(np.uint16) * 257, [cv2.IMWRITE_TIFF_COMPRESSION, 1])
    content = bytearray(path.read_bytes())
    (begin,) = struct.unpack_from("<I", content, 4)
    (count,) = struct.unpack_from("<H", content, begin)
    tags = [bytes(content[begin + 2 + 12 * i :][:12]) for i in range(count)]
    tags = [tag for tag in tags if struct.unpack("<H", tag[:2])[0] != ORIENTATION]
    tags.append(struct.pack("<HHIHH", ORIENTATION, 3, 1, orientation, 0))
    struct.pack_into("<I", content, 4, len(content))
    tags.sort(key=lambda tag: struct.unpack("<H", tag[:2]))
    path.write_bytes(bytes(content) + struct.pack("<H", len(tags)) + b"".join(tags) + bytes(4))


def test_converted_photos_follow_the_photos(tmp_path, caplog):
    """What is gone is removed; a photo that cannot be converted is tried once."""
    caplog.set_level("INFO")
    good, bad = tmp_path / "good.avif", tmp_path / "bad.avif"
    PIL.Image.new("RGB", (64, 48), "red").save(good)
    bad.write_bytes(good.read_bytes()[:100])
    folder = Folder(tmp_path / "output")
    paths = {path.name: path for path in (good, bad)}
    converted = convert_photos(folder, QUERY, paths)
    assert converted["good.avif"].suffix == ".jpg" and converted["bad.avif"] == bad
    assert "converting 2 photos" in caplog.text
    caplog.clear()
    assert convert_photos(folder, QUERY, paths) == converted and not caplog.text
    convert_photos(folder, DATABASE, {"good.avif": good})
    assert convert_photos(folder, QUERY, {}) == {}
    assert [path.parent.name for path in folder.converted.rglob("*.*")] == [DATABASE]


def test_photos_that_colmap_cannot_read_are_counted(tmp_path, caplog):
    """All of them are an error, as a single one is; some of them are a warning."""
    folder = tmp_path / "photos"
    folder.mkdir()
    for name in ("IMG_1.CR2", "IMG_2.cr2", "b.dng"):
        (folder / name).touch()
    line = r"3 files are left out: 2 \.cr2, 1 \.dng \(COLMAP cannot read them: convert to JPEG\)"
    with pytest.raises(InputError, match=line):
        find_photos(folder, [])
    with pytest.raises(InputError, match=r"IMG_1.CR2: 1 file is left out: 1 \.cr2 \(COLMAP cannot read it"):
        find_photos(folder / "IMG_1.CR2", [])
    (folder / "IMG_3.JPG").touch()
    (folder / "notes.txt").touch()
    os.mkfifo(folder / "pipe.jpg")  # whose reader would wait for ever
    assert list(find_photos(folder, [])) == ["IMG_3.JPG"] and "3 files are left out" in caplog.text


def test_videos_among_photos_are_counted(tmp_path, caplog):
    for name in ("walk.mp4", "IMG_1.MOV"):
        (tmp_path / name).touch()
    line = r"2 files are left out: 1 \.mov, 1 \.mp4 \(pass the path of a video instead of the folder's\)"
    with pytest.raises(InputError, match=line):
        find_photos(tmp_path, [])
    for name in ("IMG_1.JPG", "IMG_2.dng"):
        (tmp_path / name).touch()
    assert list(find_photos(tmp_path, [])) == ["IMG_1.JPG"]
    assert "convert to JPEG); 2 files are left out: 1 .mov" in caplog.text


def test_heic_without_its_package(tmp_path, monkeypatch):
    (tmp_path / "IMG_1.HEIC").touch()
    monkeypatch.setattr(photos_of_projects, "convertible_suffixes", lambda: (".avif",))
    with pytest.raises(InputError, match=r"1 \.heic \(COLMAP cannot read it: convert to JPEG, or install pillow-heif"):
        find_photos(tmp_path, [])


def test_phones_photos_without_exif_and_damaged_ones(place, tmp_path):
    """Decoders raise errors of many types."""
    pytest.importorskip("pillow_heif").register_heif_opener()
    photo = PIL.Image.open(place / QUERY / "0.png").convert("RGB")
    paths = {}
    for suffix in ("heic", "avif"):
        path = tmp_path / f"whole.{suffix}"
        photo.save(path, quality=80)
        data = path.read_bytes()
        paths[path.name] = path
        for index in range(60):
            damaged = bytearray(data)
            damaged[40 + 7 * index : 44 + 7 * index] = b"\xff\x00\xff\x00"
            paths[f"{index}.{suffix}"] = tmp_path / f"{index}.{suffix}"
            paths[f"{index}.{suffix}"].write_bytes(damaged)
    converted = convert_photos(Folder(tmp_path / "output"), QUERY, paths)
    assert converted.keys() == paths.keys()
    for suffix in ("heic", "avif"):
        assert photo_size(converted[f"whole.{suffix}"]) == photo.size
        assert any(converted[f"{index}.{suffix}"].suffix != ".jpg" for index in range(60))


def test_size_of_a_photo_of_200_megapixels(tmp_path):
    PIL.Image.new("RGB", (32, 24)).save(tmp_path / "photo.jpg")
    data = (tmp_path / "photo.jpg").read_bytes()
    start = data.index(b"\xff\xc0") + 5  # height and width in the frame's header
    (tmp_path / "photo.jpg").write_bytes(data[:start] + struct.pack(">HH", 12240, 16320) + data[start + 4 :])
    assert photo_size(tmp_path / "photo.jpg") == (16320, 12240)


def test_single_damaged_heic_is_not_taken_for_a_video(run, tmp_path, capsys):
    (tmp_path / "IMG_1.HEIC").write_bytes(b"\0\0\0\x18ftypheic")
    run(queries=tmp_path / "IMG_1.HEIC", exit_code=1)
    assert "IMG_1.HEIC: is not a photo that can be read" in capsys.readouterr().err


def test_output_and_masks_among_the_photos(run, place, photos, capsys):
    """The photos are reached by a link, the output folder by its own path."""
    kept = (run() / "localized" / "poses.txt").read_bytes()
    for name in photos.poses:
        path = place / DATABASE / "masks" / f"{name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.full((CAMERA.height, CAMERA.width), 255, np.uint8))
    (place / "real").mkdir()
    for role in (DATABASE, QUERY):
        (place / role).rename(place / "real" / role)
        (place / role).symlink_to(place / "real" / role)
    for role in (DATABASE, QUERY):
        output = place / "real" / role / "out"
        for _ in range(2):
            run(output=output)
            assert (output / "localized" / "poses.txt").read_bytes() == kept
    (place / "real" / DATABASE / "masks" / "elsewhere.png").touch()
    capsys.readouterr()
    output = run("--masks", place / "real" / DATABASE / "masks", output=place / "real" / DATABASE / "out")
    assert localized(output) == photos.query_names and "have no pose" not in capsys.readouterr().err


def test_masks_beside_the_photos(run, place):
    for path in list((place / DATABASE).iterdir()):
        cv2.imwrite(f"{path}.png", np.full((CAMERA.height, CAMERA.width), 255, np.uint8))
    output = run("--masks", place / DATABASE)
    assert len(list((output / "images" / DATABASE).iterdir())) == 6
    assert len(list((output / "masks" / DATABASE).iterdir())) == 6


def test_photo_that_is_database_image_and_query(run, place):
    shutil.copy(place / DATABASE / "3.png", place / QUERY / "3.png")
    assert localized(run("--sequence", "1")) == ["query/0.png", "query/1.png", "query/3.png"]


@pytest.mark.parametrize(
    ("camera", "word"),
    [
        ("PINHOL 480 360 400 400 240 180", "PINHOL"),
        ("PINHOLE 480 360 400 240 180", "PINHOLE"),
        ("PINHOLE 480 360 400 400 240 180 0", "PINHOLE"),
        ("PINHOLE 0 360 400 400 240 180", "0"),
        ("PINHOLE 480 -360 400 400 240 180", "-360"),
        ("PINHOLE 480 360 nan 400 240 180", "finite"),
        ("PINHOLE 480 360 400 inf 240 180", "finite"),
        ("PINHOLE 480 360 f f 240 180", "f"),
        ("", ""),
    ],
)
def test_bad_query_camera_is_one_line_before_any_work(run, camera, word, tmp_path, capsys):
    run("--query_camera", camera, exit_code=1)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and "--query_camera" in lines[0] and word in lines[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--frames_per_second", "3"], "--frames_per_second has no effect"),
        (["--masks", "PLACE/query"], "has no mask of any photo"),
        (["--masks", "PLACE/query", "--onnx_path", "PLACE"], "--onnx_path has no effect"),
        (["--sequence", "--LazyLocalizer.group_size", "3"], "--LazyLocalizer.group_size"),
        (["--panoramas", "database", "--camera", "PINHOLE 2 1 1 1 1 1"], "--camera"),
        (["--calibration", "none.yaml"], "--calibration none.yaml: does not exist"),
        (["stray"], "unexpected word stray: --SiftExtraction.first_octave takes one value"),
        (["--LazyLocalizer.seed", "3", "4"], "unexpected word 4: --LazyLocalizer.seed takes one value"),
        (["--SiftExtraction.num_octaves", "3"], "unknown option --SiftExtraction.num_octaves"),
        (["--output", "PLACE/query"], "is also --queries"),
    ],
)
def test_options_are_used_or_refused(run, place, words, message, capsys):
    run(*[word.replace("PLACE", str(place)) for word in words], exit_code=1)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and message in lines[0]


@pytest.mark.parametrize(
    "words",
    [
        ["--poses_format", "csv"],
        ["--calibration", "PLACE/query/0.png"],
        ["--unit", "m"],
        ["--geo_origin", "1,2,3"],
    ],
)
def test_options_of_poses_need_poses(place, words, tmp_path, capsys):
    words = [word.replace("PLACE", str(place)) for word in words]
    paths = [
        "--database_images",
        str(place / DATABASE),
        "--queries",
        str(place / QUERY),
        "--output",
        str(tmp_path / "o"),
    ]
    assert main(["run", *paths, *words]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and f"{words[0]} has no effect without --poses" in lines[0]


def test_folder_of_another_program_is_left_alone(run, place, tmp_path, capsys):
    """A COLMAP project is no output folder, nor are photos in a folder that a run replaces."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "database.db").write_text("mine")
    run("--overwrite", exit_code=1)
    assert "database.db is in it, not made by `lazyloc run`" in capsys.readouterr().err
    assert (tmp_path / "out" / "database.db").read_text() == "mine"
    (place / "images").mkdir()
    (place / QUERY).rename(place / "images" / QUERY)
    run(queries=place / "images" / QUERY, output=place, exit_code=1)
    assert "is in the output folder" in capsys.readouterr().err
    assert len(list((place / "images" / QUERY).iterdir())) == 2


def test_failing_report_is_a_warning(run, monkeypatch, capsys):
    def fail(words):
        raise ZeroDivisionError("of the page")

    output = run()
    capsys.readouterr()
    monkeypatch.setattr(report, "main", fail)
    run(exit_code=1)
    printed = capsys.readouterr()
    assert "2 of 2 queries localized" in printed.out
    assert "report.html: the report was not written (ZeroDivisionError: of the page)" in printed.err
    assert not (output / "report.html").exists()


def test_begun_step_is_forgotten_with_those_after_it(tmp_path, caplog):
    folder = Folder(tmp_path)
    steps = Steps(folder, "1")
    for name, file in (("features", "database.db"), ("matches", None), ("model", "model"), ("queries", "queries.db")):
        assert steps.begin(name, fingerprint(name))
        if file is not None:
            (tmp_path / file).touch()
        steps.finish(name, fingerprint(name))
    (tmp_path / "database.db-journal").touch()
    steps = Steps(folder, "1")
    assert not any(steps.begin(name, fingerprint(name)) for name in ("features", "matches", "model", "queries"))
    assert steps.begin("matches", "other")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["database.db", "database.db-journal", RECORD]
    steps = Steps(folder, "1")  # interrupted
    assert not steps.begin("features", fingerprint("features")) and steps.begin("matches", fingerprint("matches"))
    assert Steps(folder, "2").begin("features", fingerprint("features")), "another program"
    assert [path.name for path in tmp_path.iterdir()] == [RECORD]
    folder.steps.write_text("damaged")
    assert Steps(folder, "2").begin("features", fingerprint("features"))


def make_colmap4_database(path):
    pycolmap = pytest.importorskip("pycolmap")
    pycolmap.Database.open(str(path)).close()
    with sqlite3.connect(path) as database:
        database.executemany("INSERT INTO frame_data VALUES (?, ?, 1, 0)", [(1, 7), (2, 3), (3, 5), (4, 4)])
        database.executemany("INSERT INTO frames VALUES (?, 1)", [(1,), (2,), (3,), (4,)])
        database.execute("INSERT INTO frame_data VALUES (3, 7, 1, 1)")  # of another kind of sensor
        priors = [(1, 7, 1, 0), (2, 5, 1, 0)]
        columns = "pose_prior_id, corr_data_id, corr_sensor_id, corr_sensor_type, coordinate_system"
        database.executemany(f"INSERT INTO pose_priors ({columns}) VALUES (?, ?, ?, ?, 0)", priors)


def make_colmap3_database(path):
    with sqlite3.connect(path) as database:
        database.executescript(synthetic.SCHEMAS["3.10"])
        database.executemany("INSERT INTO pose_priors VALUES (?, NULL, 0)", [(7,), (5,)])


@pytest.mark.parametrize("make", [make_colmap3_database, make_colmap4_database])
def test_images_without_keypoints_are_removed_and_others_numbered_by_name(make, tmp_path):
    path = tmp_path / "database.db"
    make(path)
    with sqlite3.connect(path) as database:
        database.executemany("INSERT INTO images VALUES (?, ?, 1)", [(7, "a"), (3, "c"), (4, "aa"), (5, "b")])
        database.executemany("INSERT INTO keypoints VALUES (?, ?, 2, NULL)", [(7, 10), (3, 30), (5, 20)])
    for _ in range(2):
        tidy_images(path)
        with sqlite3.connect(path) as database:
            images = database.execute("SELECT image_id, name, rows FROM images JOIN keypoints USING (image_id)")
            assert sorted(images) == [(1, "a", 10), (2, "b", 20), (3, "c", 30)]
            if make is make_colmap3_database:
                assert sorted(database.execute("SELECT image_id FROM pose_priors")) == [(1,), (2,)]
                continue
            rows = database.execute("SELECT frame_id, data_id, sensor_type FROM frame_data")
            assert sorted(rows) == [(1, 1, 0), (2, 3, 0), (3, 2, 0), (3, 7, 1)]
            assert sorted(database.execute("SELECT frame_id FROM frames")) == [(1,), (2,), (3,)]
            priors = database.execute("SELECT pose_prior_id, corr_data_id FROM pose_priors")
            assert sorted(priors) == [(1, 1), (2, 2)]


def test_links_are_those_of_the_photos(tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / NOT_UTF8).write_text("a")
    folder = Folder(tmp_path / "out")
    assert link_photos(folder, QUERY, find_photos(tmp_path / "photos", [])) == {NOT_UTF8: "query/caf_.png"}
    assert (folder.images / "query" / "caf_.png").read_text() == "a"


def test_exif_shows_one_camera(tmp_path):
    """Photos of a size and a focal length have one camera if make and model are the same, and known for all."""
    wide, tall = np.zeros((30, 40, 3), np.uint8), np.zeros((40, 30, 3), np.uint8)
    paths = {name: tmp_path / f"{name}.jpg" for name in ("first", "second", "tall", "zoomed", "other", "plain")}
    for name, pixels, focal_length_35mm, model in (
        ("first", wide, 26, "One"),
        ("second", wide, 26, "One"),
        ("tall", tall, 26, "One"),
        ("zoomed", wide, 52, "One"),
        ("other", wide, 26, "Two"),
    ):
        write_jpeg(paths[name], pixels, focal_length_35mm, model=model)
    PIL.Image.fromarray(wide).save(paths["plain"])
    assert has_one_camera([paths["first"], paths["second"], paths["tall"], paths["zoomed"]])
    for name in ("other", "plain"):
        assert not has_one_camera([paths["first"], paths["second"], paths[name]])
