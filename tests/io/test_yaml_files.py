"""YAML files: limits before allocation, and one error for everything that is not YAML."""

import time
from pathlib import Path

import pytest

from lis_grasp.exceptions import InvalidFileError
from lis_grasp.io.yaml_files import is_plain_text, read_yaml


def _read(tmp_path: Path, text: str) -> object:
    path = tmp_path / "any.yaml"
    path.write_text(text, encoding="utf-8")
    return read_yaml(path)


def test_plain_values_aliases_and_merged_mappings_are_read(tmp_path: Path) -> None:
    text = "a: &a {b: 1, c: [x, 2.5, null]}\nd: {<<: *a, b: 2}\ne: [*a, *a]\n"
    a = {"b": 1, "c": ["x", 2.5, None]}
    assert _read(tmp_path, text) == {"a": a, "d": {"b": 2, "c": a["c"]}, "e": [a, a]}
    assert _read(tmp_path, "") is None


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a: !!bool maybe", "tag"),
        ("a: !!timestamp now", "tag"),
        ("a: !!int ''", "tag"),
        ("a: !!float _", "tag"),
        ("a: 1" + ":59" * 300 + ".5", "tag"),  # beyond the range of floats
        ("a: !!python/object:os.system x", "line 1, .* a tag that is not read"),
        ("a: &a [*a]", "alias"),
        ("a: 1\na: 2", "occurs 2 times"),
        ("a: 1\nb: c: d", "line 2, 'b: c: d', is no YAML"),
        ("a: \x00", "is damaged, or no YAML"),
        ("{[a]: 1}", "a key or a tag that is not read"),
    ],
)
def test_other_content_is_refused_in_a_sentence(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(InvalidFileError, match=reason):
        _read(tmp_path, text)


_MERGED = "a: &a {" + ", ".join(f"k{i}: 1" for i in range(2000)) + "}\n"
_CHAIN = "a0: &a0 {x: 1}\n" + "".join(
    f"a{i}: &a{i} {{<<: [*a{i - 1}, *a{i - 1}]}}\n" for i in range(1, 30)
)


@pytest.mark.parametrize(
    "text",
    [
        _MERGED + "b: {<<: [" + "*a, " * 2000 + "]}",
        _CHAIN,
        _CHAIN.replace("{<<: [", "[").replace("]}", "]").replace("{x: 1}", "[x]"),
        pytest.param("a: 1" + ":59" * 400_000, marks=pytest.mark.slow),
        pytest.param("a: [" + "1, " * 200_000 + "]", marks=pytest.mark.slow),
        "[" * 5000,
        "#" * (2 * 2**20 + 1),
    ],
    ids=["merged", "merged in turn", "aliases in turn", "sexagesimal", "long", "deep", "large"],
)
def test_small_files_that_cost_much_are_refused_soon(tmp_path: Path, text: str) -> None:
    start = time.process_time()
    with pytest.raises(InvalidFileError):
        _read(tmp_path, text)
    # Each took 25 s to hours; 50 000 values take 2 s on a slow machine.
    assert time.process_time() - start < 10.0


@pytest.mark.parametrize("text", ["index", "left_finger-2", "a.b/c"])
def test_plain_words_need_no_quotes(text: str) -> None:
    assert is_plain_text(text)


@pytest.mark.parametrize("text", ["", "yes", "1", "a: b", "[x", "a #b", " a", "!!bool x", "a, b"])
def test_other_words_need_quotes(text: str) -> None:
    assert not is_plain_text(text)
