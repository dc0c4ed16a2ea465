# SPDX-License-Identifier: Apache-2.0
"""docs/faults.md and docs/promises.md: each test and file that they name is there, and each cell of the fault matrix names a test
or says why there is none."""
import os
import re
import unittest
from pathlib import Path

ROOT = Path(os.environ["STILLMAP_SCRIPTS"]).parent
PAGES = [ROOT / "docs" / name for name in ("faults.md", "promises.md")]


def tests_of_rooms():
    sources = "\n".join(path.read_text() for path in sorted((ROOT / "tests").rglob("*.cpp")))
    return {f"{suite}.{name}" for suite, name in re.findall(r"^TEST(?:_F|_P)?\((\w+), *(\w+)\)", sources, re.M)}


def tests_of_clients():
    return re.findall(r'^test\("([^"]+)"', (ROOT / "tests/stream/client/client_test.mjs").read_text(), re.M)


def tables(page):
    """Of each table its head and its rows, as lists of cells."""
    found = re.findall(r"(?:^\|.*\n)+", page.read_text(), re.M)
    cells = [[[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()] for table in found]
    return [(head, rows) for head, _, *rows in cells]


class NamedTests(unittest.TestCase):
    rooms, clients = tests_of_rooms(), tests_of_clients()

    def named(self, words):
        """Tests that a text names; one that there is not fails."""
        found = []

        def must(name, there):
            self.assertTrue(there, f"{name} is no test, in: {words}")
            found.append(name)

        for name in re.findall(r"\bapp_test\.(\w+)", words):
            added = f"NAME app_test.{name} " in (ROOT / "tests/app/CMakeLists.txt").read_text()
            must(f"app_test.{name}", added or (ROOT / f"tests/app/{name}_test.py").exists())
        for name, rest in re.findall(r"\b([A-Z]\w+\.[A-Za-z]\w*)(\.\.\.)?", words):
            must(name, name in self.rooms or (rest and any(test.startswith(name) for test in self.rooms)))
        suites = {test.split(".")[0] for test in self.rooms}
        for name in re.findall(r"(?<![\w`./])([A-Z][a-z]+[A-Z]\w*)(?![\w`./])", words):
            must(name, name in suites)
        if "client test" in words or "stream client" in words:
            for quoted in re.findall(r'"([^"]+)"', words):
                beginning = quoted.removesuffix("...").strip()
                must(quoted, any(beginning in test for test in self.clients))
        for path in re.findall(r"`?((?:tests|scripts)/[\w./]+\w)", words):
            must(path, (ROOT / path).exists())
        return found

    def test_every_cell_of_the_fault_matrix_is_tested_or_explained(self):
        (head, rows), *_ = tables(PAGES[0])
        self.assertEqual(head, ["stage", "stalls", "its library throws or fails", "late", "out of order", "corrupt data", "full pool"])
        self.assertEqual([row[0] for row in rows], ["camera", "log", "detect", "track", "map", "stream", "recorder"])
        for stage, *row in rows:
            self.assertEqual(len(row), len(head) - 1)
            for fault, cell in zip(head[1:], row):
                with self.subTest(stage=stage, fault=fault):
                    self.assertTrue(re.match(r"- \(.+\)", cell) or self.named(cell), cell)

    def test_every_fault_of_the_whole_and_every_promise_names_its_test(self):
        told = [row[head.index("test")] for page in PAGES for head, rows in tables(page) if "test" in head for row in rows]
        self.assertGreater(len(told), 40)
        for cell in told:
            with self.subTest(cell=cell):
                self.assertTrue(self.named(cell))

    def test_what_is_said_of_counters_names_tests_that_are_there(self):
        (_, rows), = [table for table in tables(PAGES[0]) if table[0][0] == "counter"]
        self.assertGreaterEqual(sum(len(self.named(row[2])) for row in rows), 2)


if __name__ == "__main__":
    unittest.main()
