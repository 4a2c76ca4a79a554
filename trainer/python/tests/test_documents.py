"""The Python lines of the documents, as they stand there. Run: python3 -m pytest trainer/python/tests"""

import contextlib
import importlib.util
import io
import os
import subprocess
import sys
import unittest
import warnings
from unittest import mock

from programs import ROOT, folder, program


def lines_of(page):
    """The first block of Python of a page."""
    _, lines = (ROOT / page).read_text().split("```python\n", 1)
    return lines.split("```", 1)[0]


def run(page, *arguments):
    """Runs a page's first block in the repository's root: what it printed, by line, and its names."""
    printed, names, before = io.StringIO(), {}, os.getcwd()
    os.chdir(ROOT)
    try:
        with contextlib.redirect_stdout(printed), mock.patch.object(sys, "argv", [page, *arguments]):
            exec(compile(lines_of(page), page, "exec"), names)
    finally:
        os.chdir(before)
    return printed.getvalue().splitlines(), names


class Documents(unittest.TestCase):
    @unittest.skipUnless(importlib.util.find_spec("gymnasium"), "no Gymnasium here (pip install gymnasium)")
    def test_the_packages_own_page(self):
        (first, second), names = run("trainer/python/README.md")
        self.assertRegex(first, r"^\d+\.\d* \d+\.\d+ True \[\]$")
        # The paper's rig lacks what the measured one has, by some kPa, and is no other rig.
        self.assertTrue(0.1 < float(second.split()[0]) < 20.0, second)
        self.assertEqual((names["p_pos"].shape, names["observation"].shape), ((500,), (84,)))

    def test_the_page_about_recordings(self):
        controller = program("controller")
        with folder() as here, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            demo = [controller, "demo", "--fast", "--seconds", "2", "--policy", "fallback", "--out", str(here)]
            self.assertIn(subprocess.run(demo, capture_output=True).returncode, (0, 1))
            (recording,) = here.glob("*.mcap")
            printed, names = run("docs/recordings.md", str(recording))
        self.assertEqual(printed, [f"{len(names['ticks']['time_s'])} ticks; ['fault', 'mode', 'p_neg_kpa']"])
        self.assertGreaterEqual(len(names["ticks"]["time_s"]), 100)


if __name__ == "__main__":
    unittest.main()
