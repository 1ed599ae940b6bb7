"""Tests which pose belongs to which photo: by names, numbers of frames, times, or an order."""

import json
import unicodedata

import numpy as np
import pytest

import pose_writers
from colmap_lazyloc import import_poses
from colmap_lazyloc.errors import InputError
from pose_files import assert_poses, read, write_named
from pose_writers import make_poses, save


def with_files(tmp_path, files, seed=1):
    """Writes transforms.json with these names; returns its path and the poses."""
    truth = make_poses(files, seed)
    return pose_writers.transforms(tmp_path, truth), truth


@pytest.mark.parametrize(
    ("files", "photos"),
    [
        (["front/1.jpg", "back/1.jpg"], ["front/1.jpg", "back/1.jpg"]),
        (["front/1.jpg", "back/1.jpg", "front/2.jpg"], ["front/1.jpg", "back/1.jpg", "front/2.jpg"]),
        (["a.HEIC", "b.HEIC"], ["a.jpg", "b.jpg"]),
        (["a.png", "b.JPG"], ["a.jpg", "b.jpg"]),
        (["a", "b.1"], ["a.png", "b.1.png"]),
        (["..\\\\images\\\\a.jpg", "C:\\photos\\b.jpg"], ["a.jpg", "b.jpg"]),
        (["IMG_1.JPG", "Img_2.jpg"], ["img_1.jpg", "IMG_2.jpg"]),
        (["a.jpg", "A.jpg"], ["A.jpg", "a.jpg"]),
        ([unicodedata.normalize("NFD", "Brücke.jpg")], [unicodedata.normalize("NFC", "Brücke.jpg")]),
        (["a.jpg", "a.png"], ["a.jpg", "a.png"]),
        (["a.HEIC.jpg", "b.HEIC"], ["a.HEIC.jpg", "b.HEIC.jpg"]),
    ],
)
def test_names_that_are_written_otherwise(files, photos, tmp_path):
    path, truth = with_files(tmp_path, files)
    values = list(truth.values())
    order = [files.index(photo) for photo in photos] if sorted(files) == sorted(photos) else range(len(files))
    posed = read(path, write_named(tmp_path / "images", photos))
    assert_poses(posed, {photo: values[index] for photo, index in zip(photos, order, strict=True)})


@pytest.mark.parametrize("side", ["front", "back"])
def test_folder_of_one_camera_among_two(side, tmp_path):
    """The names of the folders above the photos decide."""
    path, truth = with_files(tmp_path, ["front/1.jpg", "back/1.jpg", "front/2.jpg", "back/2.jpg"])
    folder = write_named(tmp_path / "images" / side, ["1.jpg", "2.jpg"])
    assert_poses(read(path, folder), {name: truth[f"{side}/{name}"] for name in ("1.jpg", "2.jpg")})


def test_ambiguous_names_are_named(tmp_path, caplog):
    path, truth = with_files(tmp_path, ["1.jpg", "2.jpg"])
    folder = write_named(tmp_path / "images", ["a/1.jpg", "b/1.jpg", "2.jpg"])
    assert_poses(read(path, folder), {"2.jpg": truth["2.jpg"]})
    assert "1 of 2 poses is left out" in caplog.text and "may be a/1.jpg or b/1.jpg: give the folder" in caplog.text


def test_same_labels_of_two_flights(tmp_path):
    names = [f"{flight}/IMG_{index}.jpg" for flight in ("flight1", "flight2") for index in range(2)]
    path = pose_writers.metashape(tmp_path, make_poses(names))
    for folder in (None, write_named(tmp_path / "images", names) / "flight1"):
        with pytest.raises(InputError, match=r"two poses belong to 'IMG_0"):
            read(path, folder)


@pytest.mark.parametrize("start", [0.0, 1234.5, 1.7e9])
@pytest.mark.parametrize(("first", "step"), [(0, 1), (1, 1), (100, 10)])
def test_numbers_that_count_are_no_times(start, first, step, tmp_path, caplog):
    """Names are those of ffmpeg; 1 must not be read as a second, nor as a millisecond."""
    caplog.set_level("INFO")
    names = [f"frame_{first + step * index:04}.png" for index in range(40)]
    truth = make_poses(names)
    path = pose_writers.tum(tmp_path, truth, [start + index / 30 for index in range(40)])
    folder = write_named(tmp_path / "images", names, (64, 48))
    assert_poses(read(path, folder), truth)
    assert "order of the numbers in the names" in caplog.text
    (folder / names[7]).unlink()
    with pytest.raises(InputError, match=r"40 poses at the times .*39 photos count: give a list .*rgb\.txt"):
        read(path, folder)
    save(tmp_path, "rgb.txt", "".join(f"{start + index / 30:.9f} rgb/{name}\n" for index, name in enumerate(names)))
    truth.pop(names[7])
    assert_poses(read(path, folder), truth)
    assert "by time, " in caplog.text and "ms apart in the median" in caplog.text


def test_times_that_are_numbers_of_frames(tmp_path):
    """Some SLAM programs write the number of a keyframe for a time."""
    names = [f"{index:06}.png" for index in range(20)]
    truth = make_poses(names[::4])
    path = pose_writers.tum(tmp_path, truth, [0, 4, 8, 12, 16])
    assert_poses(read(path, write_named(tmp_path / "images", names)), truth)


def test_times_of_both_sides_that_do_not_meet_are_named(tmp_path):
    names = [f"{1700000000 + index}.5.png" for index in range(3)]
    path = pose_writers.tum(tmp_path, make_poses(names), [100.0, 100.1, 100.2])
    with pytest.raises(
        InputError, match=r"time of the trajectory, 100 to 100\.2: .*from their names, are 1700000000\.5 to"
    ):
        read(path, write_named(tmp_path / "images", names))


@pytest.mark.parametrize(
    ("name", "text"), [("times.txt", "{0}\n"), ("rgb.txt", "# a comment\n{0} rgb/{1}\n"), ("rgb.txt", "{1},{0}\n")]
)
def test_lists_of_times(name, text, tmp_path):
    """The second photo is half-way between two poses."""
    truth = make_poses(["0.jpg", "1.jpg", "2.jpg", "3.jpg"])
    path = pose_writers.tum(tmp_path, truth, [10.0, 10.1, 10.2, 10.3])
    folder = write_named(tmp_path / "images", ["0.jpg", "1.jpg"])
    save(tmp_path, name, "".join(text.format(time, photo) for photo, time in (("0.jpg", 10.0), ("1.jpg", 10.15))))
    images = {image.name: image.cam_from_world for image in read(path, folder).images}
    assert np.allclose(images["0.jpg"].cam_in_world, truth["0.jpg"][1])
    assert np.allclose(images["1.jpg"].cam_in_world, (truth["1.jpg"][1] + truth["2.jpg"][1]) / 2)


def test_times_without_names_are_in_the_order_of_numbers(tmp_path, caplog):
    names = [f"{index}.png" for index in range(12)]
    truth = make_poses(names)
    times = [10 + index / 10 for index in range(12)]
    path = pose_writers.tum(tmp_path, truth, times)
    save(tmp_path, "times.txt", "".join(f"{time}\n" for time in times))
    assert_poses(read(path, write_named(tmp_path / "images", names)), truth)
    save(tmp_path, "times.txt", "".join(f"{time}\n" for time in times[1:]))
    read(path, tmp_path / "images")
    assert "times.txt: is not used, because it has 11 times for 12 photos" in caplog.text


@pytest.mark.parametrize("form", [None, "arkit", "strayscanner"])
@pytest.mark.parametrize("missing", [[], [0, 3]])
def test_frames_of_stray_scanner(form, missing, tmp_path):
    names = [f"{index:06}.jpg" for index in range(6)]
    truth = make_poses(names)
    path = pose_writers.stray_scanner(tmp_path, truth)
    left = [name for index, name in enumerate(names) if index not in missing]
    assert_poses(read(path, write_named(tmp_path / "rgb", left), form=form), {name: truth[name] for name in left})


def test_frames_that_are_shifted_are_named(tmp_path):
    path = pose_writers.stray_scanner(tmp_path, make_poses(["a", "b", "c"]))
    folder = write_named(tmp_path / "rgb", ["000001.jpg", "000002.jpg", "000003.jpg"])
    with pytest.raises(InputError, match="has the frames 0 to 2, but the photos in .* have the numbers 1 to 3"):
        read(path, folder)


def test_poses_with_ids_belong_to_photos_by_id_or_by_time(tmp_path):
    truth = make_poses(["7", "8", "9"])
    path = pose_writers.rtabmap(tmp_path, truth)
    for name, photos in (("ids", [f"rgb/{index}.jpg" for index in range(3)]), ("times", ["1234.500000.jpg"])):
        found = dict(zip(photos, truth.values()))
        assert_poses(read(path, write_named(tmp_path / name, photos)), found)
    robot = path.rename(tmp_path / "rtabmap_poses.txt")
    with pytest.raises(InputError, match="its poses are of the body: give --calibration"):
        read(robot, tmp_path / "ids")


def test_comment_with_as_many_words_as_columns(tmp_path):
    truth = make_poses(["0.jpg"])
    path = pose_writers.tum(tmp_path, truth)
    path.write_text("# these are the poses of my robot\n" + path.read_text().splitlines()[-1] + "\n")
    assert_poses(read(path, write_named(tmp_path / "images", truth)), truth)


def test_order_is_that_of_numbers(tmp_path):
    names = [f"{index}.png" for index in range(12)]
    truth = make_poses(names)
    assert_poses(read(pose_writers.kitti(tmp_path, truth), write_named(tmp_path / "images", names)), truth)


def test_depth_images_of_7_scenes_are_no_photos(tmp_path, capsys):
    """Poses, colour and depth images are in one folder."""
    truth = make_poses([f"frame-{index:06}.color.png" for index in range(3)])
    folder = write_named(tmp_path / "seq", [*truth, *(name.replace("color", "depth") for name in truth)])
    for name, (rotation, centre) in truth.items():
        rows = np.vstack([np.column_stack([rotation, centre]), (0, 0, 0, 1)])
        save(
            folder, name.replace("color.png", "pose.txt"), "\n".join(" ".join(map(repr, row)) for row in rows.tolist())
        )
    assert_poses(read(folder, folder), truth)
    write_named(folder, ["frame-000007.depth.png"])  # beside no other image
    assert len(read(folder, folder).images) == 3


@pytest.mark.parametrize("kind", ["transforms", "poses", "csv_quaternion", "strayscanner"])
def test_pose_that_is_given_twice_counts_once(kind, tmp_path, caplog):
    names = [f"frame_{index}.jpg" for index in range(3)]
    truth = make_poses(names)
    if kind == "strayscanner":
        header = "timestamp, frame, x, y, z, qx, qy, qz, qw\n"
        rows = [(10 + i, i, *centre, *pose_writers.xyzw(turn)) for i, (turn, centre) in enumerate(truth.values())]
        text = "".join(", ".join(str(float(v)) if i > 1 else str(v) for i, v in enumerate(row)) + "\n" for row in rows)
        path = save(tmp_path, "odometry.csv", header + text)
    else:
        path = pose_writers.WRITERS[kind].write(tmp_path, truth)
    if kind == "transforms":
        data = json.loads(path.read_text())
        data["frames"].append(data["frames"][1])
        path.write_text(json.dumps(data))
    else:
        path.write_text(path.read_text() + path.read_text().splitlines()[-1] + "\n")
    assert_poses(read(path, write_named(tmp_path / "images", names)), truth)
    assert "poses" not in caplog.text


def test_what_has_no_partner_is_named_on_both_sides(tmp_path, caplog, capsys):
    path, _ = with_files(tmp_path, [f"{index}.jpg" for index in range(6)])
    folder = write_named(tmp_path / "images", ["0.jpg", "other.jpg"])
    words = ["transforms", str(path), "--image_path", str(folder), "--output_path", str(tmp_path / "model")]
    assert import_poses.main(words) == 0
    error = capsys.readouterr().err
    assert (
        "5 of 6 poses have no photo in" in error and "images/1.jpg; ./images/2.jpg; ./images/3.jpg; and 2 more" in error
    )
    assert "1 of 2 photos have no pose in" in error and error.endswith(": other.jpg\n")


def test_photos_of_another_size_are_named(tmp_path, capsys):
    """Photos have half the size, as nerfstudio's images_2, so that the focal length is that of other pixels."""
    path, _ = with_files(tmp_path, ["a.jpg", "b.jpg"])
    folder = write_named(tmp_path / "images_2", ["a.jpg", "b.jpg"], (320, 240))
    words = ["transforms", str(path), "--image_path", str(folder), "--output_path", str(tmp_path / "model")]
    assert import_poses.main(words) == 0
    assert "b.jpg has 320 x 240 pixels, but its camera 640 x 480: give intrinsics" in capsys.readouterr().err
    (folder / "b.jpg").write_bytes(b"no photo")
    assert import_poses.main(words) == 0
    assert "b.jpg: is not a photo that can be read" in capsys.readouterr().err
