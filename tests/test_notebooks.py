"""Runs the notebooks, as a reader does cell by cell."""

import nbclient
import nbformat

from conftest import PROJECT_PATH


def test_first_poses(tmp_path, colmap, monkeypatch):
    monkeypatch.setenv("COLMAP", str(colmap))
    notebook = nbformat.read(PROJECT_PATH / "examples" / "notebooks" / "first_poses.ipynb", nbformat.NO_CONVERT)
    assert not any(cell.get("outputs") for cell in notebook.cells)
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    text = "".join(output["text"] for output in outputs if output["output_type"] == "stream")
    assert "4 of 4 queries localized" in text and "shift of the new photos, by 9 points" in text
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 2
    assert (tmp_path / "localization" / "report.html").exists()
