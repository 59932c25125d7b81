"""Notes of one kind are one line with a count; all others are shown as they are."""

from __future__ import annotations

from rigctl.analysis.notes import summarise_notes


def test_a_hundred_notes_of_one_kind_are_one_line() -> None:
    torn = [
        f"/day/{n}: {n} trials left out for gaps in their samples: {n}, {n + 1}, 30 …"
        for n in range(2, 101)
    ]
    single = ["/day/0: 1 trial left out for gaps in their samples: 7"]
    other = ["/day/5: attempts left out: 3 aborted", "constant taxels: 5, 18"]
    shown = summarise_notes([*single, other[0], *torn, other[1]])
    assert shown == [
        f"{single[0]} (and 99 more notes of this kind: results.json has them all)",
        *other,
    ]


def test_names_in_quotes_and_subjects_do_not_make_a_kind() -> None:
    notes = [f"{task}: texture 'x{n}' has no group" for n, task in enumerate("abc")]
    (line,) = summarise_notes(notes, rest_in="the session")
    assert line == f"{notes[0]} (and 2 more notes of this kind: the session has them all)"


def test_two_of_a_kind_and_different_sentences_stay() -> None:
    notes = ["a: left out, too few trials", "b: left out, too few trials", "a: no group", "c: none"]
    assert summarise_notes(notes) == notes
    assert summarise_notes([]) == []
