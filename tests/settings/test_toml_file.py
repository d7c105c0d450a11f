"""A TOML file may hold anything: what cannot be used is one clear sentence, never a traceback."""

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal, refused

from sumo_eval.errors import InputError
from sumo_eval.settings.toml_file import DEEPEST, line_of, read_toml, toml_from

DIGITS = "1" * 5_000
WRONG = {
    "a number of 5,000 digits": (f"x = {DIGITS}", "is not valid TOML: Exceeds the limit"),
    "an integer of 4,000 digits": (
        f"x = {DIGITS[:4_000]}",
        "must hold integers of at most 64 bits",
    ),
    "an integer of 65 bits": (f"x = {2**64}", "must hold integers of at most 64 bits"),
    "lists in lists": (f"x = {'[' * 5_000}{']' * 5_000}", "must not be nested more than 50 deep"),
    "lists a little too deep": (
        f"x = {'[' * DEEPEST}{']' * DEEPEST}",
        "must not be nested more than 50 deep",
    ),
    "tables in tables": (
        f"[{'.'.join('a' * 3_000)}]\nx = 1",
        "must not be nested more than 50 deep",
    ),
    "inline tables": (
        "x = " + "{a = " * 900 + "1" + "}" * 900,
        "must not be nested more than 50 deep",
    ),
    "NUL": (r'x = "a\u0000b"', r"must hold text without control characters, got 'a\x00b'"),
    "an escape sequence": (r'x = ["\u001b[2J"]', "must hold text without control characters"),
    "turned writing": ('x = "\u202e"', "must hold text without control characters"),
    "a key with NUL": (r'"a\u0000" = 1', "must hold text without control characters"),
    "no TOML": ("x = ", "is not valid TOML"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_used_is_refused(name):
    text, words = WRONG[name]
    with refused(words) as caught:
        toml_from(text, "The file")

    assert str(caught.value).startswith("The file ")
    assert len(str(caught.value)) < 500


def test_a_line_ends_where_toml_ends_it():
    assert line_of("# one\u2028line\r\nname = 1\n", ("name",)) == 2


@pytest.mark.parametrize("control", ["000b", "000c", "001c", "001f", "0085", "2028", "2029"])
def test_law_no_control_character_passes_as_a_space(control):
    with refusal("must hold text without control characters"):
        toml_from(f'x = "a\\u{control}b"', "The file")


def test_an_address_is_no_control_character():
    assert toml_from('x = "meet at 0x12>"', "The file") == {"x": "meet at 0x12>"}


def test_law_a_key_in_quotes_has_its_own_line():
    text = '[a]\nx = 1\n[b."c.d".e]\ny = 2\n"p.q" = 3\n'
    assert [line_of(text, ("b", "c.d", "e", key)) for key in ("y", "p.q")] == [4, 5]
    assert line_of(text, ("a", "y")) == 1


def test_long_texts_and_lists_hold_no_keys():
    text = 'a = """\nn = 1\n"""\n[[s]]\np = [\n  [1],\n  [2]\n]\nq = "[" # {\nn = 2'
    assert line_of(text, ("n",)) is None
    assert line_of(text, ("s", 0, "n")) == 10


def test_ordinary_content_is_read_as_it_is():
    text = (
        'a = -9223372036854775808\nb = """two\nlines\tand a tab"""\nc = '
        f'{"[" * 20}1.5{"]" * 20}\nd = "Fußgänger"'
    )
    assert toml_from(text, "The file")["a"] == -(2**63)
    assert toml_from(text, "The file")["b"] == "two\nlines\tand a tab"


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused_with_a_message(text):
    for content in (text, f"x = {text}", f'x = "{text}"', f"[{text}]"):
        try:
            toml_from(content, "The file")
        except InputError as error:
            str(error).encode("utf-8")


def test_what_is_not_a_file_is_refused(tmp_path):
    (tmp_path / "latin").write_bytes(b'name = "\xe9"')
    (tmp_path / "folder").mkdir()
    (tmp_path / "closed").write_text("x = 1")
    (tmp_path / "closed").chmod(0)
    cases = {
        tmp_path / "nowhere": "There is no test file",
        tmp_path / "folder": "cannot be read: ",
        tmp_path / "latin": r"cannot be read: 'utf-8' codec.*\. Save it as UTF-8\.$",
        tmp_path / "latin" / "below": "cannot be read: ",
        tmp_path / ("x" * 300): "cannot be read: ",
        tmp_path / "a\x00b": "cannot be read: ",
    }
    if os.geteuid() != 0:  # whom nothing is closed to
        cases[tmp_path / "closed"] = "cannot be read: "
    for path, words in cases.items():
        with refusal(words):
            read_toml(path, "test file")
