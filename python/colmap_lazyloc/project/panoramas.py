"""Cuts the panoramas of a project into faces, and writes their rig."""

import pathlib
from collections.abc import Mapping, Sequence

from colmap_lazyloc.errors import InputError, logger
from colmap_lazyloc.panoramas import REFERENCE, find_widths, write_faces, write_rig
from colmap_lazyloc.project.folder import content, fingerprint
from colmap_lazyloc.project.photos import MAX_NUM_NAMED
from colmap_lazyloc.project.steps import Project


def cut_panoramas(
    project: Project, role: str, paths: Mapping[str, pathlib.Path]
) -> tuple[pathlib.Path, dict[str, int]]:
    """Cuts panoramas into faces; returns the folder of the faces, and the widths by name of the panoramas.

    Panoramas that cannot be used are left out.
    """
    output, step = project.folder.faces / role, f"{role} faces"
    key = fingerprint([(name, content(path)) for name, path in paths.items()])
    is_new = project.steps.begin(step, key)
    if is_new:
        logger.info("faces of %d panoramas", len(paths))
    widths: dict[str, int] = {}
    errors = []
    for name, path in paths.items():
        try:
            width = find_widths({name: path})
            if is_new:
                write_faces({name: path}, output)
        except InputError as error:
            errors.append(str(error))
            continue
        if (output / REFERENCE / name).exists():
            widths |= width
    project.steps.finish(step, key)
    num_left_out = len(paths) - len(widths)
    text = "; ".join(errors[:MAX_NUM_NAMED]) or "they cannot be read"
    if not widths:
        raise InputError(text)
    if num_left_out > 0:
        logger.warning("%d of %d panoramas are left out: %s", num_left_out, len(paths), text)
    return output, widths


def write_project_rig(project: Project, roles: Sequence[str]) -> pathlib.Path:
    """Writes the rig of the faces of database images, of queries, or of both."""
    path = project.folder.write_list("rig", [])
    write_rig(path, [f"{role}/" for role in roles])
    return path
