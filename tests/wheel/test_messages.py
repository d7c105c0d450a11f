"""What a browser may say: everything else is a sentence, never a traceback."""

import json

import pytest

from sumo_eval.extras.wheel.hands import Given
from sumo_eval.extras.wheel.messages import MessageError, read


def test_what_the_page_sends_is_understood():
    assert read('{"input": [7, 3, "keys", 5, 0, 0, 0]}')["input"] == (
        7,
        3,
        Given("keys", 5, 0.0, 0.0, 0.0),
    )
    assert read('{"input": [1, -1, "wheel", 0, -7.5, 1, 0.25]}')["input"].given == Given(
        "wheel", 0, -7.5, 1.0, 0.25
    )
    assert read('{"ready": true}') == {"ready": True}
    assert read('{"pause": "hidden"}') == {"pause": "hidden"}
    assert (
        read('{"answers": {"effort": 7, "remark": "a\\u0000b\\ud800"}}')["answers"]["effort"] == 7.0
    )
    told = {
        "frames": 60,
        "dropped": 1,
        "stepped": 0,
        "latency": [20.5],
        "resolution": 0.6,
        "renderer": "WebGL",
    }
    assert read(json.dumps({"telling": told})) == {"telling": told}


@pytest.mark.parametrize("text", [
    b"\x00", None, "", "{", "[]", "null", "{}", '{"a": 1, "b": 2}', '{"nothing": 1}', "[" * 5000,
    '{"input": [0, 0, "keys", 0, NaN, 0, 0]}', '{"input": [0, 0, "keys", 0, 1e999, 0, 0]}',
    '{"input": [0, 0, "keys", 64, 0, 0, 0]}', '{"input": [0, 0, "feet", 0, 0, 0, 0]}',
    '{"input": [0.5, 0, "keys", 0, 0, 0, 0]}', '{"input": [true, 0, "keys", 0, 0, 0, 0]}',
    '{"input": [0, 0, "stick", 0, 1.01, 0, 0]}', '{"input": [0, 0, "stick", 0, 0, -0.1, 0]}',
    '{"input": [0, 0, "keys", 0, 0, 0]}', '{"input": [0, 0, ["keys"], 0, 0, 0, '
                                          '0]}', '{"token": 5}', '{"ready": 1}',
    '{"pause": "never"}', '{"answers": [1]}', '{"answers": {"a": null}}', '{"answers": {"a": [1]}}',
    '{"telling": {"frames": 1}}', '{"input": [0, 0, "stick", 0, 1' + "0" * 400 + ", 0, 0]}",
    '{"input": [1' + "0" * 400 + ', 0, "stick", 0, 0, 0, '
                                 '0]}', '{"input": [0, 1' + "0" * 400 + ', "stick", 0, 0, 0, 0]}',
    '{"answers": {"a": -1' + "0" * 400 + "}}",
    '{"telling": {"frames": -1, "dropped": 0, "stepped": 0, "latency": [], "resolution": 1, '
    '"renderer": ""}}',
])  # fmt: skip
def test_what_our_pages_never_send_is_refused(text):
    with pytest.raises(MessageError, match=r"^[A-Z].*\.$"):
        read(text)
