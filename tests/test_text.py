"""Text from outside: nothing that harms, no more than is kept, and nothing lost without a mark."""

import csv
import io

import pandas as pd
import pytest

from sumo_eval.errors import check_name, must_be, said
from sumo_eval.text import (
    LOG,
    SENTENCE,
    WORDS,
    capitalised,
    cell,
    clean,
    clean_log,
    each_text,
    from_cell,
    shown,
    traceback_of,
    words_of,
)

HARMFUL = {
    "NUL": ("a\x00b", r"a\x00b"),
    "escape sequence": ("a\x1b[2Jb", r"a\x1b[2Jb"),
    "C1 control": ("a\x9b2Jb", r"a\x9b2Jb"),
    "right to left": ("a\u202eb\u2066c", r"a\u202eb\u2066c"),
    "lone surrogate": ("a\ud800b\udfff", r"a\ud800b\udfff"),
    "no character": ("a\uffffb", r"a\uffffb"),
    "addresses": ("<f of <a at 0x7f1B> at 0x2>, at 0x3", "<f of <a>>, at 0x3"),
    "addresses amid": ("<F at 0x1 state=a>, <c at 0x2, file b>", "<F state=a>, <c, file b>"),
    "line end of Unicode's own": ("a\u2028b", r"a\u2028b"),
}


@pytest.mark.parametrize("name", HARMFUL)
def test_what_harms_is_replaced_by_its_number(name):
    text, expected = HARMFUL[name]
    assert clean(text) == expected
    assert clean_log(text) == expected


def test_addresses_without_an_end_are_read_once():
    """Looked for again at each of them it takes a minute."""
    text = " at 0x1" * 50_000
    assert clean(text, len(text)) == text


def test_ordinary_text_of_any_language_is_left_alone():
    for text in (
        "no path found",
        "Fußgänger, 歩行者, עובר",
        "emoji 👩\u200d🚀",
        "tab\tand \\x1b as words",
    ):
        assert clean(text) == clean_log(text) == text


def test_a_sentence_is_one_line_and_a_log_keeps_its_lines():
    assert clean("one\r\ntwo\rthree") == "one two\\rthree"
    assert clean_log("one\r\ntwo\r100 %") == "one\ntwo\n100 %"


@pytest.mark.parametrize("letter", ["x", "\x00", "\ud800", "\n", "👩"])
@pytest.mark.parametrize("length", [0, 1, 80, SENTENCE, SENTENCE + 1, 3 * LOG, 40_000_000])
def test_any_text_becomes_short_valid_and_stays_as_it_is(letter, length):
    for cleaned, most, again in ((clean, SENTENCE, clean), (clean_log, LOG, clean_log)):
        found = cleaned(letter * length)
        assert len(found) <= most
        assert again(found) == found
        found.encode("utf-8")
        assert "\x00" not in found
        assert "left out" in found or length <= most


def test_what_is_cut_says_how_much_was_left_out():
    found = clean("x" * 1_000)
    kept = found.count("x")
    assert found == f"{'x' * kept} … [{1_000 - kept} characters left out]"
    found = clean_log("b" * 10_000 + "e" * 10_000)
    assert found.startswith("b" * 1_000)
    assert found.endswith("e" * 1_000)
    kept = found.count("b") + found.count("e") - 2  # `characters` and `left` have an e each
    assert f"[{20_000 - kept} characters left out]" in found


class Odd(str):
    """A text whose methods are the user's."""

    def replace(self, *arguments):
        raise RuntimeError

    def __getitem__(self, key):
        raise RuntimeError

    def __len__(self):
        raise RuntimeError


class SpeechlessError(Exception):
    def __str__(self):
        raise KeyboardInterrupt

    __repr__ = __str__


class SurrogateError(Exception):
    def __str__(self):
        return "\ud800"

    __repr__ = __str__


class Names(type):
    @property
    def __name__(cls):
        raise RuntimeError


class NamelessError(Exception, metaclass=Names):
    pass


class SpeaksOddlyError(Exception):
    def __str__(self):
        return Odd("an odd text")


ODD = {
    SpeechlessError(): "SpeechlessError: (its text is not available: __str__ raised "
    "KeyboardInterrupt)",
    SurrogateError(): r"SurrogateError: \ud800",
    NamelessError("words"): "NamelessError: words",
    SpeaksOddlyError(): "SpeaksOddlyError: an odd text",
    ValueError(): "ValueError",
    ValueError("no path.\n"): "ValueError: no path",
    SystemExit(3): "SystemExit: 3",
}


@pytest.mark.parametrize(
    "error", ODD, ids=lambda error: type.__dict__["__name__"].__get__(type(error))
)
def test_any_exception_can_be_put_in_words_and_logged(error):
    assert said(error) == ODD[error]
    assert len(traceback_of(error)) <= LOG
    traceback_of(error).encode()
    shown(error).encode()


def test_a_long_exception_leaves_room_for_the_sentence_around_it():
    assert len(words_of(ValueError("x" * 40_000_000))) <= WORDS
    assert len(traceback_of(ValueError("x" * 40_000_000))) <= LOG


def test_what_was_got_is_shown_whatever_it_is():
    assert "must be small, got (int that cannot be shown: ValueError)." in str(
        must_be("`a`", "b", "small", 10**5000)
    )
    assert len(str(must_be("`a`", "b", "small", "x" * 10**6))) < SENTENCE


def test_a_name_that_cannot_be_shown_is_refused():
    check_name("an ADS", "[red] =Fußgänger (2)")
    for name in ("a\nb", "\x1b[2J", "\u202eeman", "x" * (SENTENCE + 1)):
        with pytest.raises(
            ValueError, match="must be one line of at most 500 characters that can be shown"
        ):
            check_name("an ADS", name)


FORMULAS = ("=1+2", "'=1+2", "+cmd", "-2+3", "@SUM(A1)", "\t=1", "\r=1", '=HYPERLINK("http://x")')


@pytest.mark.parametrize("text", FORMULAS)
def test_a_cell_that_a_spreadsheet_would_run_is_quoted_and_read_back(text):
    assert cell(text) == f"'{text}"
    assert from_cell(cell(text)) == text


@pytest.mark.parametrize(
    "value", ["-1.5", "+2", "-1e-9", "-inf", -1.5, None, "", "a=b", "it's", "'tis", True]
)
def test_numbers_and_ordinary_cells_stay_as_they_are(value):
    assert cell(value) is value
    assert from_cell(value) is value


def test_a_table_is_quoted_in_text_and_headings_and_read_back():
    table = pd.DataFrame(
        {"=name": ["=a", "b"], "x": [-1.5, 2.0], "n": [1, -2], "mixed": [None, "-2+3"]}
    )
    text = each_text(table, cell).to_csv(index=False)
    assert list(csv.reader(io.StringIO(text)))[:2] == [
        ["'=name", "x", "n", "mixed"],
        ["'=a", "-1.5", "1", ""],
    ]
    assert each_text(pd.read_csv(io.StringIO(text)), from_cell).to_csv() == table.to_csv()


def test_capitalised_keeps_names():
    assert capitalised("parameter `A` of Mine.toml") == "Parameter `A` of Mine.toml"
