"""Cuts the panoramas of a project into faces, and states their rig."""

import pathlib
import shutil
from collections.abc import Sequence

from colmap_lazyloc.errors import logger
from colmap_lazyloc.panoramas import find_widths, list_panoramas, write_faces, write_rig
from colmap_lazyloc.project.folder import fingerprint
from colmap_lazyloc.project.steps import Project


def cut_panoramas(project: Project, role: str, source: pathlib.Path) -> tuple[pathlib.Path, dict[str, int]]:
    """Cuts the panoramas of a folder, or a single one; returns the folder of their faces, and their widths by name."""
    paths = list_panoramas(source)
    widths = find_widths(paths)
    output, step = project.folder.faces / role, f"{role} faces"
    key = fingerprint(files=paths.values())
    if not project.steps.is_done(step, key):
        logger.info("faces of %d panoramas", len(paths))
        shutil.rmtree(output, ignore_errors=True)
        write_faces(paths, output)
        project.steps.finish(step, key)
    return output, widths


def write_project_rig(project: Project, roles: Sequence[str]) -> pathlib.Path:
    """Writes the rig of the faces of database images, of queries, or of both."""
    path = project.folder.write_list("rig", [])
    write_rig(path, [f"{role}/" for role in roles])
    return path
