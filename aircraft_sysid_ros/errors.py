"""The exceptions that a user is meant to read, and how they show what came from outside."""

from __future__ import annotations

from typing import Any

#: Characters of one input that a sentence shows, and of a whole sentence.
_LONGEST_ECHO, _LONGEST_SENTENCE = 60, 1200
#: Control characters but the end of a line; marks of nothing and of direction; halves of characters.
_CONTROL_RANGES = (
    (0, 9), (11, 31), (127, 159), (0x200B, 0x200F), (0x202A, 0x202E), (0x2066, 0x2069), (0xD800, 0xDFFF),
)  # fmt: skip
_CONTROL = dict.fromkeys(number for first, last in _CONTROL_RANGES for number in range(first, last + 1))


def one_line(text: str) -> str:
    """Any white space is one space; what does not print is left out, such as what moves the cursor of a terminal."""
    return "".join(character for character in " ".join(text.split()) if character.isprintable())


def without_control(text: str) -> str:
    """Lines for a terminal without what would move its cursor, change its colours, or turn the order of letters."""
    return text.translate(_CONTROL)


def echo(text: str, longest: int = _LONGEST_ECHO) -> str:
    """Input as a sentence shows it: one line, cut short."""
    text = one_line(text)
    return text if len(text) <= longest else text[:longest] + "…"


class InputError(ValueError):
    """Bad input from outside (file, recording, option): one sentence that says what is wrong and what to do.

    The command line prints it on one line and exits with status 2; a node logs it and stays unconfigured. Whatever
    was put into it prints, and it has an end.
    """

    def __init__(self, sentence: str) -> None:
        text = one_line(sentence)
        if len(text) > _LONGEST_SENTENCE:  # what to do stands at the end
            text = f"{text[: _LONGEST_SENTENCE // 2]} … {text[-_LONGEST_SENTENCE // 2 :]}"
        super().__init__(text)


class IncompleteError(Exception):
    """Something is missing in what was done: one sentence that says what and how much, with ``result``, what there is.

    The command line prints both, and exits with status 1.
    """

    def __init__(self, sentence: str, result: dict[str, Any]) -> None:
        super().__init__(sentence)
        self.result = result
