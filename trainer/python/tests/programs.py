"""What the tests share: the repository's programs, a folder that goes away, a table without any package."""

import contextlib
import csv
import os
import shutil
import tempfile
import unittest
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]


def program(name):
    """A program of the repository; skips the test where there is none."""
    built = ROOT / "target/release" / name
    found = os.environ.get(name.upper()) or (str(built) if built.exists() else shutil.which(name))
    if not found:
        raise unittest.SkipTest(f"no program {name}: build it, or say with {name.upper()} where it is")
    return found


@contextlib.contextmanager
def folder():
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def table(file):
    """Columns of a CSV file, the ones that hold numbers; an empty cell is NaN."""
    with open(file, newline="") as lines:
        names, *rows = csv.reader(lines)
    columns = {}
    for name, cells in zip(names, zip(*rows)):
        with contextlib.suppress(ValueError):
            columns[name] = np.array([float(cell or "nan") for cell in cells])
    return columns
