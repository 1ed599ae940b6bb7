"""Tests that every run of `colmap lazy_localizer` leaves the database file and its folder byte-identical."""

import os
import pathlib
import shutil
import sqlite3
import subprocess
import tempfile

import pytest

from colmap_lazyloc.testing import synthetic

NOBODY = 65534


@pytest.fixture
def open_folder():
    """Makes a folder that every user of the machine may enter; pytest's own are private."""
    folder = pathlib.Path(tempfile.mkdtemp(prefix="lazyloc_"))
    folder.chmod(0o755)
    yield folder
    for path in [folder, *folder.rglob("*")]:
        path.chmod(0o755)
    shutil.rmtree(folder)


@pytest.fixture
def pending_wal(exact):
    """Makes a database.db whose tables are still in its WAL, without a -shm file, as a crashed program leaves it."""

    def make(folder):
        live = folder / "live"
        live.mkdir()
        connection = sqlite3.connect(live / "database.db")
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA wal_autocheckpoint = 0")
        connection.executescript(synthetic.SCHEMAS["3.10"])
        synthetic.insert_scene(connection, exact.scene)
        for name in ("database.db", "database.db-wal"):
            shutil.copy(live / name, folder / name)
        connection.close()
        shutil.rmtree(live)
        assert (folder / "database.db-wal").stat().st_size > (folder / "database.db").stat().st_size
        return folder / "database.db"

    return make


def as_other_user(colmap, folder):
    """Runs the program as nobody, because root may write everywhere.

    Takes a copy if the program's folder, root's home for example, is closed to that user. Elsewhere the program runs in
    place, because that of a wheel needs libraries beside it.
    """
    if os.geteuid() != 0:
        return {}
    options = {"user": NOBODY, "group": NOBODY, "extra_groups": []}
    try:
        subprocess.run([colmap, "help"], capture_output=True, check=False, **options)
    except PermissionError:
        colmap = shutil.copy(colmap, folder / "colmap")
    return {**options, "executable": colmap}


def read_only_mount(folder):
    """Returns a launcher that sees the folder mounted read-only; skips the test if the machine does not allow it."""
    launcher = [
        "unshare",
        "--mount",
        "sh",
        "-c",
        f"mount --bind '{folder}' '{folder}' && mount -o remount,ro,bind '{folder}' && exec \"$@\"",
        "sh",
    ]
    probe = ["sh", "-c", f"! touch '{folder}/probe' 2>/dev/null"]
    if shutil.which("unshare") is None or subprocess.run([*launcher, *probe], capture_output=True).returncode != 0:
        (folder / "probe").unlink(missing_ok=True)
        pytest.skip("a read-only bind mount needs root and the right to mount")
    return launcher


def write_kind(kind, folder, scene, pending_wal):
    if kind == "pycolmap":
        from colmap_lazyloc.testing import synthetic_pycolmap

        return synthetic_pycolmap.write_pycolmap_database(folder / "database.db", scene)
    if kind == "pending WAL":
        return pending_wal(folder)
    path = synthetic.write_database(folder / "database.db", scene)
    if kind == "WAL":
        connection = sqlite3.connect(path)
        connection.execute("PRAGMA journal_mode = WAL")
        connection.close()
        assert path.read_bytes()[18:20] == b"\2\2"  # SQLite's mark of a database in WAL mode
    return path


@pytest.mark.parametrize("kind", ["rollback journal", "WAL", "pending WAL", "pycolmap"])
@pytest.mark.parametrize("where", ["writable", "chmod", "mount"])
def test_database_folder_is_untouched(
    colmap, localize, exact, open_folder, tmp_path, fingerprint, pending_wal, kind, where
):
    database_folder = open_folder / "database"
    database_folder.mkdir()
    database_path = write_kind(kind, database_folder, exact.scene, pending_wal)
    model_path = synthetic.write_model(open_folder / "model", exact.scene)
    output_path, options = tmp_path / "output", {}
    if where == "chmod":
        for path in database_folder.iterdir():
            path.chmod(0o444)
        database_folder.chmod(0o555)
        output_path, options = open_folder / "output", as_other_user(colmap, open_folder)
        output_path.mkdir()
        output_path.chmod(0o777)
    elif where == "mount":
        options = {"launcher": read_only_mount(database_folder)}
    before = fingerprint(database_folder)
    run = localize("--database_path", database_path, "--input_path", model_path, output_path=output_path, **options)
    run.assert_localized(exact.scene, exact.scene.query_names, 5e-7, 5e-6)
    assert fingerprint(database_folder) == before


def test_model_list_and_pairs_files_are_untouched(localize, exact, tmp_path, fingerprint, write_scene_files):
    folder = tmp_path / "input"
    folder.mkdir()
    files = write_scene_files(folder, exact.scene)
    (folder / "list.txt").write_text("query/000.jpg\n")
    (folder / "pairs.txt").write_text("".join(f"query/000.jpg {name}\n" for name in exact.scene.database_names))
    before = fingerprint(folder)
    run = localize(*files.arguments, "--query_list_path", folder / "list.txt", "--pairs_path", folder / "pairs.txt")
    run.assert_localized(exact.scene, ["query/000.jpg"], 5e-7, 5e-6)
    assert fingerprint(folder) == before


def test_database_is_untouched_when_raw_matches_are_verified(localize, noisy, tmp_path, fingerprint):
    """The geometries that are estimated in memory are not written back."""
    folder = tmp_path / "database"
    folder.mkdir()
    database_path = synthetic.write_database(folder / "database.db", noisy.scene, geometry=None)
    before = fingerprint(folder)
    run = localize("--database_path", database_path, "--input_path", noisy.model_path)
    run.assert_localized(noisy.scene, noisy.scene.query_names, 0.012, 0.12)
    assert fingerprint(folder) == before


def test_database_is_untouched_beside_an_open_writer(localize, exact, tmp_path, fingerprint):
    """Another program has the database open in WAL mode, and its changes are still in the WAL."""
    folder = tmp_path / "database"
    folder.mkdir()
    connection = sqlite3.connect(folder / "database.db")
    connection.execute("PRAGMA journal_mode = WAL")
    connection.executescript(synthetic.SCHEMAS["3.10"])
    synthetic.insert_scene(connection, exact.scene)
    assert (folder / "database.db-shm").exists()
    before = fingerprint(folder)
    run = localize("--database_path", folder / "database.db", "--input_path", exact.model_path)
    assert fingerprint(folder) == before
    connection.close()
    run.assert_localized(exact.scene, exact.scene.query_names, 5e-7, 5e-6)


def test_failures_leave_the_database_untouched(localize, exact, tmp_path, fingerprint, write_scene_files):
    scene = exact.scene.copy()
    scene.images["query/001.jpg"].keypoints[5, 0] = float("nan")
    files = write_scene_files(tmp_path, scene)
    before = fingerprint(tmp_path)
    assert localize(*files.arguments).statuses["query/001.jpg"] == "DAMAGED_DATA"
    assert localize(*files.arguments, "--query_list_path", tmp_path / "missing.txt").exit_code == 1
    assert fingerprint(tmp_path) == before


def test_output_into_the_databases_folder_adds_only_the_outputs(localize, exact, tmp_path, write_scene_files):
    files = write_scene_files(tmp_path, exact.scene)
    (tmp_path / "model").rename(tmp_path / "input_model")
    before = files.database_path.read_bytes()
    run = localize(
        "--database_path", files.database_path, "--input_path", tmp_path / "input_model", output_path=tmp_path
    )
    run.assert_localized(exact.scene, exact.scene.query_names, 5e-7, 5e-6)
    assert files.database_path.read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {
        "database.db",
        "input_model",
        "model",
        "options.ini",
        "poses.txt",
        "positions.csv",
        "results.jsonl",
    }
