"""Downloads archives from their authors' servers."""

import pathlib
import shutil
import sys
import tempfile
import urllib.error
import urllib.request
import zipfile

from colmap_lazyloc.errors import InputError


def download_archives(archives: dict[str, str], data_path: pathlib.Path, by_hand: str):
    """Unpacks the zip file of each URL into its folder below `data_path`, and then the zip files in it."""
    for url, folder in archives.items():
        target = data_path / folder
        target.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=data_path) as work_path:
            archive_path = pathlib.Path(work_path) / "archive.zip"
            print(f"fetching {url}", file=sys.stderr, flush=True)
            try:
                with urllib.request.urlopen(url) as response, archive_path.open("wb") as file:
                    shutil.copyfileobj(response, file)
                unpack(archive_path, target)
            except (urllib.error.URLError, OSError, zipfile.BadZipFile) as error:
                raise InputError(f"--download: {url}: {error}. By hand: {by_hand}") from None


def unpack(archive_path: pathlib.Path, target: pathlib.Path):
    with zipfile.ZipFile(archive_path) as archive:
        archive.extractall(target)
        inner = [target / name for name in archive.namelist() if name.endswith(".zip")]
    for path in inner:
        unpack(path, path.parent)
        path.unlink()
