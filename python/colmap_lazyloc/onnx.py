"""Tells the program where the package onnxruntime has its library, which the program loads for ALIKED features."""

import importlib.util
import os
import pathlib

LIBRARY_VARIABLE = "LAZYLOC_ONNXRUNTIME"


def offer_onnxruntime() -> None:
    """Sets the environment variable that names the library, if it is not set and the package is installed."""
    spec = importlib.util.find_spec("onnxruntime")
    if LIBRARY_VARIABLE in os.environ or spec is None or spec.origin is None:
        return
    for library in sorted((pathlib.Path(spec.origin).parent / "capi").glob("libonnxruntime.so*")):
        os.environ[LIBRARY_VARIABLE] = str(library)
