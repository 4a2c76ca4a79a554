"""Recordings as arrays: what the programs read is what Python reads. Run: python3 -m pytest trainer/python/tests"""

import gzip
import os
import re
import shutil
import subprocess
import tempfile
import unittest
import warnings
from pathlib import Path

import numpy as np

import dual_pressure
from programs import ROOT, folder, program, table

HOLDS = ROOT / "docs/examples/first_diagnosis/holds.csv"


def read_quietly(*arguments):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return dual_pressure.read_recording(*arguments)


class Tables(unittest.TestCase):
    def setUp(self):
        self.plain = dual_pressure.read_recording(HOLDS)

    def assert_same(self, found):
        for column, values in self.plain.items():
            np.testing.assert_array_equal(found[column], values, column)

    def test_columns_are_the_files_numbers(self):
        written = table(HOLDS)
        self.assertEqual(set(self.plain), set(written))
        for column in ("u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa"):
            np.testing.assert_array_equal(self.plain[column], written[column])
        # Rows are 20 ms apart, whatever jitter the file has.
        np.testing.assert_allclose(self.plain["time_s"], written["time_s"], atol=1e-3)
        self.assertTrue(self.plain.measured.all())
        self.assertEqual((self.plain.source, self.plain.notes), (str(HOLDS), []))

    def test_a_path_that_is_no_utf_8_is_a_path(self):
        with folder() as here:
            name = os.fsencode(here) + b"/l\xfcft.csv"
            with open(name, "wb") as file:
                file.write(HOLDS.read_bytes())
            self.assert_same(read_quietly(name))
            self.assert_same(read_quietly(os.fsdecode(name)))
            with self.assertRaisesRegex(ValueError, "must be UTF-8; rename"):
                read_quietly(HOLDS, name)

    def test_what_loggers_and_other_tools_make_of_it(self):
        text = HOLDS.read_text()
        header, *rows = text.splitlines()
        decimal_commas = [header.replace(",", ";")] + [row.replace(",", ";").replace(".", ",") for row in rows]
        block = ["Device: logger 7", "Operator,nobody", "", header, "s,-,-,kPa,kPa", *rows]
        in_bar = [header.replace("p_pos_kpa", "p_pos_kpa [bar]"), *map(in_bar_of, rows)]
        for name, content in {
            "zipped.csv.gz": gzip.compress(text.encode()),
            "tabs.txt": text.replace(",", "\t").encode(),
            "decimal_commas.csv": "\r\n".join(decimal_commas).encode(),
            "header_block.csv": "\n".join(block).encode(),
            "utf16.csv": text.encode("utf-16"),
        }.items():
            with self.subTest(name), folder() as here:
                (here / name).write_bytes(content)
                self.assert_same(read_quietly(here / name))
        with folder() as here:
            (here / "bar.csv").write_text("\n".join(in_bar))
            with self.assertWarnsRegex(UserWarning, "bar"):
                found = dual_pressure.read_recording(here / "bar.csv")
            np.testing.assert_allclose(found["p_pos_kpa"], self.plain["p_pos_kpa"], atol=1e-9)
            self.assertTrue(any("bar" in note for note in found.notes))

    def test_foreign_names_and_sparse_samples_by_a_rig_file(self):
        with folder() as here:
            lines = ["Time,Pressure,PWM"] + [f"{0.1 * k:.1f},{2 * k},{10 * k}" for k in range(20)]
            (here / "log.csv").write_text("\n".join(lines) + "\n")
            found = read_quietly(here / "log.csv", ROOT / "docs/rigs/softbot_pump.toml")
            self.assertEqual(set(found), {"time_s", "u_pump", "p_line_kpa"})
            np.testing.assert_allclose(np.diff(found["time_s"]), 0.02)
            # A sample every five rows is evidence, straight lines between them are not.
            self.assertEqual(found.measured.sum(), 20)
            np.testing.assert_allclose(found["p_line_kpa"][found.measured], 2.0 * np.arange(20))
            np.testing.assert_allclose(found["u_pump"][found.measured][:19], np.arange(19) * 10 / 255, rtol=1e-9)

    def test_columns_of_text_are_lists(self):
        rows = [f"{0.02 * k:.2f},0.8,0.7,{80 + k},{-70 - k},step {k // 50}" for k in range(100)]
        with folder() as here:
            (here / "run.csv").write_text("\n".join(["time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa,label", *rows]) + "\n")
            found = dual_pressure.read_recording(here / "run.csv")
        self.assertEqual(found["p_pos_kpa"].tolist(), [80.0 + k for k in range(100)])
        self.assertEqual(found["label"][49:51], ["step 0", "step 1"])

    def test_refusals_are_one_line_with_the_file_and_the_place(self):
        with folder() as here:
            (here / "percent.csv").write_text("time_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n0.00,80,70,90,-70\n0.02,80,70,90,-70\n")
            (here / "sheet.parquet").write_bytes(b"PAR1" + bytes(100))
            for file, words in [
                ("no_such.csv", "No such file"),
                ("percent.csv", "line 2, column 2 (u_pos)"),
                ("sheet.parquet", "Parquet"),
            ]:
                with self.subTest(file), self.assertRaises(ValueError) as refused:
                    dual_pressure.read_recording(here / file)
                self.assertIn(words, str(refused.exception))
                self.assertIn(file, str(refused.exception))
                self.assertNotIn("\n", str(refused.exception))
        with self.assertRaisesRegex(ValueError, "built in are dual_pressure, bench"):
            dual_pressure.read_recording(HOLDS, "no_such_rig")


def octave_of(test):
    octave = os.environ.get("OCTAVE") or shutil.which("octave-cli")
    if not octave:
        test.skipTest("no octave-cli here; OCTAVE says where it is")
    return octave


class Octave(unittest.TestCase):
    """The lines for MATLAB in docs/recordings.md that GNU Octave has as well."""

    def test_what_the_pages_line_saves_is_read_to_the_bit(self):
        octave = octave_of(self)
        save = re.search(r"`(save\('run\.mat', .*)`\.", (ROOT / "docs/recordings.md").read_text())[1]
        made = "time_s = 0.02*(0:499)'; u_pos = 0.8 + 0.1*sin(time_s); u_neg = 0.7 + 0.1*cos(time_s);"
        made += "p_pos_kpa = 90 + 5*sin(time_s); p_neg_kpa = -70 - 3*cos(time_s);"
        for version in ("-v7", "-v6"):
            with self.subTest(version), folder() as here:
                lines = f"{made} {save.replace('-v7', version)}; csvwrite('p_pos.csv', p_pos_kpa, 'precision', '%.17g');"
                subprocess.run([octave, "--eval", lines], cwd=here, check=True, capture_output=True)
                found = read_quietly(here / "run.mat")
                expected = [float(line) for line in (here / "p_pos.csv").read_text().split()]
                np.testing.assert_array_equal(found["p_pos_kpa"], expected)
                self.assertEqual(set(found), {"time_s", "u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa"})


class RecordingOfTheDaemon(unittest.TestCase):
    """A demo's recording: it begins standing by, without a reference."""

    @classmethod
    def setUpClass(cls):
        cls.controller = program("controller")
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        demo = ["demo", "--fast", "--seconds", "12", "--policy", "fallback", "--out", cls.folder.name]
        # Status 1: the run is there, and not good; that is not asked here.
        assert subprocess.run([cls.controller, *demo], capture_output=True).returncode in (0, 1)
        (cls.recording,) = Path(cls.folder.name).glob("*.mcap")

    def exported(self, *options):
        out = Path(self.folder.name) / "run.csv"
        command = [self.controller, "export", str(self.recording), "--csv", *options, "--out", str(out)]
        subprocess.run(command, check=True, capture_output=True)
        return table(out)

    def test_the_pages_line_for_octave_keeps_empty_cells_empty(self):
        octave = octave_of(self)
        read = re.search(r"`(T = dlmread\('run\.csv', [^`]*)`", (ROOT / "docs/recordings.md").read_text())[1]
        exported = self.exported("--all")
        column = list(exported).index("ref_pos_kpa") + 1
        lines = f"{read}; csvwrite('ref_pos.csv', T(:, {column}), 'precision', '%.17g');"
        subprocess.run([octave, "--eval", lines], cwd=self.folder.name, check=True, capture_output=True)
        found = [float(line) for line in (Path(self.folder.name) / "ref_pos.csv").read_text().split()]
        self.assertTrue(np.isnan(found).any() and not np.isnan(found).all(), "a demo begins without a reference")
        np.testing.assert_array_equal(found, exported["ref_pos_kpa"])

    def test_ticks_are_what_the_program_exports(self):
        found, exported = dual_pressure.read_ticks(self.recording), self.exported("--all")
        self.assertGreater(len(found["time_s"]), 500)
        self.assertEqual(list(found), list(exported))
        for column, values in exported.items():
            np.testing.assert_array_equal(found[column], values, column)
        self.assertTrue(np.isnan(found["ref_pos_kpa"]).any() and np.isfinite(found["ref_pos_kpa"]).any())

    def test_rows_are_those_that_the_program_exports_and_what_is_left_out_is_told(self):
        with self.assertWarnsRegex(UserWarning, "have a reference; ref_pos_kpa and ref_neg_kpa left out"):
            found = dual_pressure.read_recording(self.recording)
        # The program leaves out the rows that have no reference instead, those before arming, and counts time from there.
        exported = self.exported()
        rows = len(exported["time_s"])
        self.assertLess(rows, len(found["time_s"]))
        for column in set(exported) - {"ref_pos_kpa", "ref_neg_kpa", "time_s"}:
            np.testing.assert_array_equal(found[column][-rows:], exported[column], column)

    def test_of_what_is_no_recording_one_line(self):
        with self.assertRaisesRegex(ValueError, "holds.csv: "):
            dual_pressure.read_ticks(HOLDS)


def in_bar_of(row):
    time_s, u_pos, u_neg, p_pos, p_neg = row.split(",")
    return f"{time_s},{u_pos},{u_neg},{float(p_pos) / 100!r},{p_neg}"


if __name__ == "__main__":
    unittest.main()
