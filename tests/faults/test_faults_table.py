"""docs/faults.md: twenty rows, and each names a test that exists."""

import ast
import re
from pathlib import Path

import pytest

HERE = Path(__file__).parent
TEXT = (HERE.parents[1] / "docs" / "faults.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (\d+) \| (.+?) \| (.+?) \| `([\w.]+)::(\w+)` \|$", TEXT, re.MULTILINE)


def test_there_are_twenty_rows_in_order():
    assert [int(row[0]) for row in ROWS] == list(range(1, 21))


@pytest.mark.parametrize(("file", "name"), [row[3:] for row in ROWS])
def test_a_row_names_a_test_that_exists_and_is_not_slow(file, name):
    tree = ast.parse((HERE / file).read_text(encoding="utf-8"))
    found = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name]
    assert len(found) == 1
    assert "pytest.mark.slow" not in map(ast.unparse, found[0].decorator_list)


@pytest.mark.parametrize(("number", "file", "name"), [(row[0], *row[3:]) for row in ROWS])
def test_its_name_tells_the_fault(number, file, name):
    assert name.startswith(f"test_fault_{number}_") or file == "test_faults_logs.py"


def test_the_soak_is_where_the_page_says():
    (command,) = re.findall(r"```sh\npython (\S+) .*\n```", TEXT)
    assert (HERE.parents[1] / command).is_file()
