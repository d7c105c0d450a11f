"""Locators: the file as it is now, and a sentence for a name that is not there."""

from refusals import refusal

from sumo_eval.settings.locators import load_object


def test_an_edited_file_is_loaded_again_an_unchanged_one_not(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("class Ads: gap = 1\n")
    first = load_object("mine.py:Ads", tmp_path, "ADS")
    assert load_object("mine.py:Ads", tmp_path, "ADS") is first
    file.write_text("class Ads: gap = 22\n")
    assert load_object("mine.py:Ads", tmp_path, "ADS").gap == 22


def test_a_name_in_another_form_of_unicode_is_found(tmp_path):
    (tmp_path / "mine.py").write_text("class Gr\u00f6sse: gap = 1\n", "utf-8")
    assert load_object("mine.py:Gro\u0308sse", tmp_path, "ADS").gap == 1


def test_a_name_inside_a_number_is_refused(tmp_path):
    with refusal(r"`math` has no `pi\.x`"):
        load_object("math:pi.x", tmp_path, "ADS")


def test_a_module_whose_names_fail_is_refused_in_a_sentence(tmp_path):
    (tmp_path / "lazy.py").write_text('def __getattr__(name): raise ImportError("no torch")')
    with refusal(r"ADS `lazy\.py:Ads`: `Ads` of `lazy\.py` failed: ImportError: no torch\."):
        load_object("lazy.py:Ads", tmp_path, "ADS")


def test_a_name_that_is_too_long_for_a_file_is_refused(tmp_path):
    with refusal("File name too long"):
        load_object(f"{'a' * 300}.py:Ads", tmp_path, "ADS")
