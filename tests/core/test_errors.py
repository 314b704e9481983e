import os
import signal

import pytest

from intervis import InputError
from intervis.errors import finishing, mitsuba_errors, one_sentence, suggest


@pytest.mark.parametrize(
    ("raw", "sentence"),
    [
        (
            '[parser.cpp:444] While loading dictionary node "root": Found 2 unreferenced properties in '
            'integrator plugin of type "direct":\n  - integer "foo": 3\n  - integer "bar": 2',
            "integrator 'direct' has no parameter 'foo', 'bar'",
        ),
        (
            '[parser.cpp:444] While loading a.xml (line 4, col 4): Found 1 unreferenced property in sensor '
            'plugin of type "perspective":\n  - float "fovv": 45',
            "a.xml (line 4, col 4): sensor 'perspective' has no parameter 'fovv'",
        ),
        (
            '[parser.cpp:1718] At dictionary node "root": failed to instantiate unknown plugin of type '
            '"nix": [PluginManager] Plugin "nix" not found!',
            "there is no plugin 'nix'",
        ),
        (
            '[parser.cpp:1718] At dictionary node "root": failed to instantiate unknown plugin of type '
            '"tst": Traceback (most recent call last):\n  File "p.py", line 9, in __init__\n'
            "intervis.errors.InputError: 'n' must be >= 1 (got 0)",
            "'n' must be >= 1 (got 0)",
        ),
        ("[parser.cpp:111] Found unused parameters:\n  - $zzz=3", "the scene has no parameter 'zzz'"),
        (
            '[parser.cpp:1087] Parsing of XML file "bad.xml" failed: Start-end tags mismatch (line 6, col 3)',
            'Parsing of XML file "bad.xml" failed: Start-end tags mismatch (line 6, col 3)',
        ),
    ],
    ids=["parameters", "in a file", "plugin", "from python", "scene parameter", "xml"],
)
def test_mitsubas_messages_become_sentences(raw, sentence):
    assert one_sentence(RuntimeError(raw)) == sentence


def test_the_innermost_cause_is_reported():
    with pytest.raises(InputError, match="^render: no light$") as caught, mitsuba_errors("render: "):
        try:
            raise ValueError("no light")
        except ValueError as error:
            raise RuntimeError("error (see above)") from error
    assert isinstance(caught.value.__cause__, RuntimeError)


def test_an_error_without_words_has_its_name():
    assert one_sentence(AssertionError()) == "AssertionError"


def test_own_errors_and_interruptions_pass_through():
    with pytest.raises(InputError, match="^mine$"), mitsuba_errors("prefix: "):
        raise InputError("mine")
    with pytest.raises(KeyboardInterrupt), mitsuba_errors():
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise RuntimeError("error (see above)") from error


def test_one_interruption_waits_until_files_are_written():
    done = []
    with finishing() as came:
        os.kill(os.getpid(), signal.SIGINT)
        done.append("whole")
    assert done == ["whole"] and came
    with pytest.raises(KeyboardInterrupt), finishing():
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        done.append("more")
    assert done == ["whole"]
    # Others that end a run are held back alike, where they would end it by raising
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with finishing() as came:
            os.kill(os.getpid(), signal.SIGTERM)
        assert came == [signal.SIGTERM]
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
    finally:
        signal.signal(signal.SIGTERM, before)
    # Afterwards the first counts again
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)


def test_suggestions():
    assert suggest("penumbraa", ["fence", "penumbra"]) == "; did you mean 'penumbra'?"
    assert suggest("xyz", ["fence", "penumbra"]) == ""
